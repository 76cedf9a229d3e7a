"""Tests that take seconds, each with a faster like of it: the marker ``slow`` by their names.

A row is the beginning of the names of tests, of sidecars as well, and that of a test which checks
the same in less time.  `tests/conftest.py` marks the former, and refuses a row of which either is
not there when all tests are collected.  Families over all shipped models choose their
representatives in their own files.
"""

PLANE = "models/linkages"
BALANCERS = "models/balancers"
RODS = "models/rods"
FOUR = f"{BALANCERS}/balancer4_sam_prescribed.toml::pymunk"
MUTATIONS = "tests/test_mutations.py::test_a_wrong"
LENGTHS = (
    "tests/test_mutations.py::test_a_length_wrong_by_three_times_its_detectable_change_differs"
)
SNAPS = "tests/sim/test_rod_snap_engines.py::test_engines_snap_where_their_chain_does"
FIRST_PLACES = (
    "tests/sim/test_rods_2rfr.py::test_the_pin_begins_the_documents_circles_and_rectangles"
)
LONG = {
    # pymunk finds each pose of a sweep by itself: one linkage of a kind, MuJoCo runs them all
    f"{PLANE}/fivebar.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/fivebar_down.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/fivebar_equal.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/fivebar_circle.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/fivebar_rectangle.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/double_crank_crossed.toml::pymunk": f"{PLANE}/double_crank.toml::pymunk",
    f"{PLANE}/double_rocker.toml::pymunk": f"{PLANE}/triple_rocker.toml::pymunk",
    f"{PLANE}/fourbar_crossed.toml::pymunk": f"{PLANE}/fourbar.toml::pymunk",
    f"{PLANE}/inverted_slider_crank_equal.toml::pymunk": (
        f"{PLANE}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANE}/inverted_slider_crank_faster.toml::pymunk": (
        f"{PLANE}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANE}/inverted_slider_crank_held.toml::pymunk": (
        f"{PLANE}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANE}/slider_crank_mirrored.toml::pymunk": f"{PLANE}/slider_crank.toml::pymunk",
    f"{PLANE}/slider_crank_inclined.toml::pymunk": f"{PLANE}/slider_crank_offset.toml::pymunk",
    f"{PLANE}/hacksaw_sampled.toml::pymunk": f"{PLANE}/hacksaw.toml::pymunk",
    f"{PLANE}/hacksaw_inventor_shaped.toml::pymunk": f"{PLANE}/hacksaw.toml::pymunk",
    f"{PLANE}/hacksaw_recorded.toml::pymunk": f"{PLANE}/hacksaw.toml::pymunk",
    # each asks that nothing else of the case differs
    f"{PLANE}/hacksaw_cutting.toml::pymunk": (
        f"{MUTATIONS}_load_on_the_slider_turns_the_holding_moment_alone[hacksaw_cutting"
    ),
    f"{PLANE}/inverted_slider_crank_forces.toml::pymunk": (
        f"{MUTATIONS}_mass_turns_what_knows_it_and_nothing_else[inverted_slider_crank_forces"
    ),
    f"{PLANE}/inverted_slider_crank_classic.toml::pymunk": (
        f"{PLANE}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANE}/threeprr_second.toml::pymunk": f"{PLANE}/threeprr.toml::pymunk",
    f"{PLANE}/chebyshev_lambda.toml::pymunk": f"{PLANE}/watt.toml::pymunk",
    f"{PLANE}/stephenson.toml::pymunk": f"{PLANE}/watt.toml::pymunk",
    # balancers of one template
    f"{BALANCERS}/balancer4_sam_shaped.toml::pymunk": FOUR,
    f"{BALANCERS}/balancer4_sam.toml::pymunk": FOUR,
    f"{BALANCERS}/balancer4_sine.toml::pymunk": FOUR,
    f"{BALANCERS}/balancer4_sine.toml::mujoco:settled": (
        f"{BALANCERS}/balancer_sine_free_preload.toml::mujoco:settled"
    ),
    f"{BALANCERS}/balancer_designed.toml::pymunk": f"{BALANCERS}/balancer_sine.toml::pymunk",
    f"{BALANCERS}/balancer_designed_laevo.toml::pymunk": f"{BALANCERS}/balancer_sine.toml::pymunk",
    f"{BALANCERS}/balancer_laevo.toml::pymunk": f"{BALANCERS}/balancer_sine.toml::pymunk",
    f"{BALANCERS}/balancer_progressive_contact.toml::mujoco:settled": (
        f"{BALANCERS}/balancer_sine_free_preload.toml::mujoco:settled"
    ),
    f"{BALANCERS}/balancer_progressive_locked.toml::pymunk": (
        f"{BALANCERS}/balancer_progressive_contact.toml::pymunk"
    ),
    f"{BALANCERS}/balancer_prototype.toml::pymunk": (
        "tests/sim/test_friction.py::test_the_built_balancer_rubs_in_pymunk_as_in_its_reference"
    ),
    f"{BALANCERS}/balancer_sine180.toml::pymunk": f"{BALANCERS}/balancer_sine.toml::pymunk",
    f"{BALANCERS}/balancer_sine_free.toml::pymunk": (
        f"{BALANCERS}/balancer_sine_free_preload.toml::pymunk"
    ),
    f"{BALANCERS}/balancer_sine_preload.toml::pymunk": (
        f"{BALANCERS}/balancer_sine_free_preload.toml::pymunk"
    ),
    f"{BALANCERS}/balancer_third_preload_at_once.toml::pymunk": (
        f"{BALANCERS}/balancer_third_preload.toml::pymunk"
    ),
    # rods
    f"{RODS}/rfr2_circles.toml": f"{FIRST_PLACES}[rfr2_circles",
    f"{RODS}/rfr2_rectangles.toml": f"{FIRST_PLACES}[rfr2_rectangles",
    f"{RODS}/rfr2_driven.toml::pymunk": (
        "tests/sim/test_rods_2rfr.py::test_a_motion_of_both_motors_is_that_of_the_chains[pymunk"
    ),
    f"{RODS}/pfr3.toml::pymunk": f"{RODS}/rfr2_load_path.toml::pymunk",
    f"{RODS}/rfr2_missed.toml::pymunk": f"{RODS}/rfr2_natural.toml::pymunk",
    f"{RODS}/rod_into_circle.toml::pymunk": f"{RODS}/rod_cantilever.toml::pymunk",
    f"{RODS}/rod_wind.toml::pymunk": f"{RODS}/rod_cantilever.toml::pymunk",
    f"{RODS}/rod_sheared.toml::pymunk": (
        "tests/sim/test_rods_strained.py::test_a_strained_cantilever_rests_where_its_chain_does"
        "[half-both-pymunk"
    ),
    f"{RODS}/rod_taut.toml::pymunk": (
        "tests/sim/test_rods_taut.py::test_both_engines_sag_alike_and_symmetrically"
    ),
    f"{RODS}/rod_snap.toml::pymunk": f"{SNAPS}[pymunk",
    f"{RODS}/slider_crank_elastic.toml::pymunk": (
        "tests/sim/test_rods_in_motion.py::test_an_elastic_coupler_in_pymunk_is_off_by_the_square"
    ),
    "tests/sim/test_rods_in_motion.py::test_another_rod_is_noticed[slider_crank_elastic": (
        "tests/sim/test_rods_in_motion.py::test_another_rod_is_noticed[rod_released"
    ),
    "tests/sim/test_rods_2rfr.py::test_motors_lead_the_pin_along_the_documents_paths": (
        f"{FIRST_PLACES}[rfr2_circles"
    ),
    "tests/sim/test_rods_2rfr.py::test_beyond_its_fold_the_pair_snaps": f"{SNAPS}[pymunk",
    "tests/sim/test_rods_driven.py::test_a_motor_bends_a_pair_of_rods": (
        "tests/sim/test_rods_2rfr.py::test_a_motion_of_both_motors_is_that_of_the_chains[mujoco"
    ),
    "tests/sim/test_rod_flex.py::test_another_rod_is_found_out": (
        "tests/sim/test_engine_decides.py::test_springs_1_percent_stiffer_differ[rod_flex"
    ),
    "tests/sim/test_rods.py::test_orders_and_the_limit_of_a_cantilever[5-pymunk": (
        "tests/sim/test_rods.py::test_orders_and_the_limit_of_a_cantilever[2-pymunk"
    ),
    "tests/sim/test_rods.py::test_orders_and_the_limit_of_a_cantilever[10-pymunk": (
        "tests/sim/test_rods.py::test_orders_and_the_limit_of_a_cantilever[2-pymunk"
    ),
    "tests/sim/test_rods.py::test_all_stable_equilibria_of_a_pair[S1-pymunk": (
        "tests/sim/test_rods.py::test_all_stable_equilibria_of_a_pair[S2-pymunk"
    ),
    "tests/sim/test_rods.py::test_all_stable_equilibria_of_a_pair[S3-pymunk": (
        "tests/sim/test_rods.py::test_all_stable_equilibria_of_a_pair[S2-pymunk"
    ),
    "tests/sim/test_changing_loads.py::test_a_load_along_a_path_is_the_load_of_each_place"
    "[rod_platform_driven": (
        "tests/sim/test_changing_loads.py::test_a_load_along_a_path_is_the_load_of_each_place"
        "[rod_pair_driven"
    ),
    "tests/sim/test_motion.py::test_poses_next_to_a_snap_are_among_few": (
        "tests/sim/test_motion.py::test_a_mechanism_is_drawn_on_both_sides_of_its_snaps"
    ),
    "tests/sim/test_rods_strained.py::test_order_under_its_own_weight[shear-pymunk": (
        "tests/sim/test_rods_strained.py::test_order_under_its_own_weight[axial-pymunk"
    ),
    "tests/sim/test_rods_strained.py::test_order_under_its_own_weight[both-pymunk": (
        "tests/sim/test_rods_strained.py::test_order_under_its_own_weight[axial-pymunk"
    ),
    "tests/sim/test_changing_loads.py::test_a_platform_carries_a_load_that_grows": (
        f"{RODS}/rfr2_load_path.toml::mujoco"
    ),
    "tests/sim/test_rods_2rfr.py::test_a_wrong_pair_is_found": (
        "tests/sim/test_engine_decides.py::test_springs_1_percent_stiffer_differ[rfr2_natural"
    ),
    "tests/sim/test_numbers.py::test_a_change_is_where_it_was_meant_and_nowhere_else[rfr3": (
        "tests/sim/test_numbers.py::test_a_change_is_where_it_was_meant_and_nowhere_else"
        "[rfr2_natural"
    ),
    "tests/sim/test_rod_snap_engines.py::test_a_sweep_without_time_ends_at_the_fold": (
        "tests/sim/test_rods_2rfr.py::test_a_sweep_ends_at_the_fold_of_its_chains"
    ),
    "tests/sim/test_friction.py::test_every_friction_of_a_shipped_model_is_noticed"
    "[shaft_pendulum-1-pymunk": (
        "tests/sim/test_friction.py::test_every_friction_of_a_shipped_model_is_noticed"
        "[shaft_pendulum-0-pymunk"
    ),
    "tests/sim/test_friction.py::test_a_cycle_of_the_shaft_loses_its_closed_area[pymunk": (
        "tests/sim/test_friction.py::test_stick_and_slip_change_in_the_sample_of_the_closed_form"
        "[pymunk"
    ),
    f"{MUTATIONS}_number_turns_the_motion_of_the_parallelograms[pos": (
        f"{MUTATIONS}_number_turns_the_motion_of_the_parallelograms[qpos"
    ),
    f"{LENGTHS}[shaft_pendulum-length-pymunk": (
        "tests/sim/test_friction.py::test_every_friction_of_a_shipped_model_is_noticed"
        "[shaft_pendulum-0-pymunk"
    ),
    f"{LENGTHS}[fivebar-left_crank-pymunk": f"{LENGTHS}[fourbar-crank-pymunk",
    f"{LENGTHS}[hacksaw-crank-pymunk": f"{LENGTHS}[slider_crank-crank-pymunk",
    f"{LENGTHS}[inverted_slider_crank_classic-crank-pymunk": (
        f"{LENGTHS}[inverted_slider_crank-crank-pymunk"
    ),
    f"{LENGTHS}[balancer_sine_free_preload-pendulum-pymunk": (
        f"{LENGTHS}[balancer4_sam_prescribed-pendulum-pymunk"
    ),
    f"{LENGTHS}[balancer4_sine-pendulum-mujoco": (
        f"{LENGTHS}[balancer4_sam_prescribed-pendulum-mujoco"
    ),
    f"{LENGTHS}[hacksaw_recorded-crank-mujoco": f"{LENGTHS}[hacksaw-crank-mujoco",
    "tests/sim/test_friction.py::test_every_friction_of_a_shipped_model_is_noticed"
    "[balancer_prototype-1-mujoco": (
        "tests/sim/test_friction.py::test_every_friction_of_a_shipped_model_is_noticed"
        "[balancer_prototype-0-mujoco"
    ),
    # what commands write, read and say, by whole runs
    "tests/test_worker.py::test_a_sidecar_that_is_nested_deeply_is_an_error_of_its_own[tables": (
        "tests/test_worker.py::test_a_sidecar_that_is_nested_deeply_is_an_error_of_its_own[arrays"
    ),
    "tests/test_worker.py::test_a_reference_that_takes_too_long_costs_itself_only": (
        "tests/test_worker.py::test_a_model_that_is_too_large_costs_itself_only"
    ),
    "tests/test_same_digits.py::test_check_gives_the_same_digits": (
        "tests/test_same_digits.py::test_workers_solve_equations_to_the_same_bits"
    ),
    "tests/test_diagnosis.py::test_a_number_of_the_model_is_named_where_the_reference_has_none": (
        "tests/test_diagnosis.py::test_a_longer_rocker_whose_centre_of_mass_stays_is_named"
    ),
    "tests/test_diagnosis.py::test_a_failed_item_of_pytest_tells_the_cause": (
        "tests/test_command_line.py::test_an_item_fails_where_check_would_and_says_why"
    ),
    "tests/test_diagnosis.py::test_a_number_of_the_model_is_named[balancer_sine": (
        "tests/test_diagnosis.py::test_a_number_of_the_model_is_named[slider_crank"
    ),
    "tests/test_notebooks.py::test_a_notebook_runs[hacksaw": (
        "tests/test_notebooks.py::test_a_notebook_runs[fourbar"
    ),
    "tests/test_examples_chosen.py::test_true_rates_are_derivatives[fourbar_released": (
        "tests/test_examples_chosen.py::test_true_rates_are_derivatives"
    ),
    "tests/test_benchmarks.py::test_benchmark_runs_quickly_and_writes_no_documents[rod]": (
        "tests/test_benchmarks.py::test_benchmark_runs_quickly_and_writes_no_documents[rod_table2"
    ),
    "tests/report/test_report.py::test_drawing_has_the_names_of_the_mjcf[hacksaw": (
        "tests/report/test_report.py::test_drawing_has_the_names_of_the_mjcf[fivebar"
    ),
    "tests/studies/trade/test_trade_floor.py::test_a_bias_is_found_by_taking_it_away": (
        "tests/studies/trade/test_trade_floor.py::test_a_bias_is_found"
    ),
    "tests/studies/trade/test_trade_floor.py::test_segments_of_a_rod_in_motion_are_found": (
        "tests/studies/trade/test_trade_floor.py::test_segments_of_a_rod_are_found"
    ),
    "tests/studies/diet/test_diet_bare.py::test_a_step_as_long_as_the_error_allows": (
        "tests/studies/diet/test_diet_models.py::test_a_longer_step_is_held_against_the_reference"
    ),
    # pages in a browser
    "tests/report/test_browser.py::test_every_channel_of_every_run_can_be_shown[balancer_sine": (
        "tests/report/test_browser.py::test_every_channel_of_every_run_can_be_shown[slider_crank"
    ),
    "tests/report/test_browser.py::test_every_channel_of_every_run_can_be_shown[fourbar": (
        "tests/report/test_browser.py::test_every_channel_of_every_run_can_be_shown[slider_crank"
    ),
    "tests/studies/diet/test_diet_chart.py::test_axe_finds_nothing[dark": (
        "tests/studies/diet/test_diet_chart.py::test_axe_finds_nothing[light"
    ),
    "tests/studies/stress/test_stress_chart.py::test_axe_finds_nothing[dark": (
        "tests/studies/stress/test_stress_chart.py::test_axe_finds_nothing[light"
    ),
    "tests/studies/test_study_pages_browser.py::test_axe_finds_nothing[trade/fourbar-dynamics"
    "-trade.html-dark": (
        "tests/studies/test_study_pages_browser.py::test_axe_finds_nothing[stress/index.html-dark"
    ),
    # references of mechanisms in space, over the whole of their runs
    "tests/analytic/spatial/test_spatial_loops.py::test_a_slider_crank_by_a_quadrature[5.0": (
        "tests/analytic/spatial/test_spatial_loops.py::test_a_slider_crank_by_a_quadrature[0.5"
    ),
    "tests/analytic/spatial/test_spatial_loops.py::test_bricard_by_one_equation[10": (
        "tests/analytic/spatial/test_spatial_loops.py::test_bricard_by_one_equation[2.0"
    ),
    "tests/analytic/spatial/test_spatial_tops.py::test_a_heavy_top_is_in_elliptic_functions[2.0": (
        "tests/analytic/spatial/test_spatial_tops.py::test_a_heavy_top_is_in_elliptic_functions[0.2"
    ),
    # references of rods
    "tests/analytic/rods/test_rod_solutions_bound.py::test_galerkin_method_finds_them_as_well"
    "[rfr3-1-230": (
        "tests/analytic/rods/test_rod_solutions_bound.py::test_galerkin_method_finds_them_as_well"
        "[rfr3-1-170"
    ),
    "tests/analytic/rods/test_rod_pair_driven.py::test_four_rectangles_of_the_document": (
        "tests/analytic/rods/test_rod_pair_driven.py::test_turns_of_the_motors_join_the_equilibria"
    ),
    "tests/analytic/rods/test_rod_pair_driven.py::test_five_circles_of_the_document": (
        "tests/analytic/rods/test_rod_pair_driven.py::test_turns_of_the_motors_join_the_equilibria"
    ),
    "tests/analytic/rods/test_rod_cantilever.py::test_every_branch[load3": (
        "tests/analytic/rods/test_rod_cantilever.py::test_every_branch[load0"
    ),
    "tests/analytic/rods/test_rod_cantilever.py::test_potential_by_virtual_work[load2": (
        "tests/analytic/rods/test_rod_cantilever.py::test_potential_by_virtual_work[load0"
    ),
}
