"""Names of tests that take seconds and get the marker ``slow``, with their faster counterparts.

`LONG` maps the beginning of the names of slow tests, including items of sidecars,
to the beginning of the name of a test that checks the same in less time.

`SOME` has a list of words for each of some tests with parameters.  Those whose
parameters contain one of the words run by default; the others are slow.

`tests/conftest.py` sets the markers.  When all tests are collected, it refuses a row that marks no
test as slow, and a row whose counterpart or word matches no test or only slow tests.  Tests of all
shipped models choose their representatives in their own files.
"""

PLANE = "models/linkages"
SPACE = "models/spatial"
BALANCERS = "models/balancers"
RODS = "models/rods"
FOUR = f"{BALANCERS}/balancer4_sam_prescribed.toml::pymunk"
MUTATIONS = "tests/test_mutations.py::test_a_wrong"
LENGTHS = (
    "tests/test_mutations.py::test_a_length_wrong_by_three_times_its_detectable_change_differs"
)
EXTENSION = (
    "tests/analytic/balancer/test_balancer_extension.py"
    "::test_engines_agree_and_another_extension_turns_the_verdict"
)
HELD = (
    "tests/sim/pymunk/test_pymunk_statics.py::test_balancers_hold_the_moments_of_their_equilibria"
)
SNAPS = "tests/sim/test_rod_snap_engines.py::test_engines_snap_where_their_chain_does"
VALID = "tests/test_names_and_units.py::test_own_cases_are_valid"
SNAPS_LATER = "tests/sim/test_motion.py::test_an_engine_that_snaps_later_is_drawn_on_its_own_side"
BENCHMARK = "tests/test_benchmarks.py::test_benchmark_runs_quickly_and_writes_no_documents"
FIRST_PLACES = (
    "tests/sim/test_rods_2rfr.py::test_the_pin_begins_the_documents_circles_and_rectangles"
)
LONG = {
    "tests/sim/test_rods_in_space.py::test_a_wrong_stiffness_about_z_differs": (
        "tests/sim/test_rods_in_space.py::test_either_side_bends_against_its_own_stiffness"
    ),
    # pymunk solves each pose of a sweep anew: it runs one linkage of each kind, MuJoCo runs all
    f"{PLANE}/fivebar.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/fivebar_down.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/fivebar_equal.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/fivebar_circle.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/fivebar_rectangle.toml::pymunk": f"{PLANE}/fivebar_regular.toml::pymunk",
    f"{PLANE}/double_crank.toml::pymunk": f"{PLANE}/fourbar.toml::pymunk",
    f"{PLANE}/double_crank_crossed.toml::pymunk": f"{PLANE}/fourbar.toml::pymunk",
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
    f"{PLANE}/slider_crank_inclined.toml::pymunk": f"{PLANE}/slider_crank.toml::pymunk",
    f"{PLANE}/slider_crank_offset.toml::pymunk": f"{PLANE}/slider_crank.toml::pymunk",
    f"{PLANE}/hacksaw_sampled.toml::pymunk": f"{PLANE}/hacksaw.toml::pymunk",
    f"{PLANE}/hacksaw_inventor_shaped.toml::pymunk": f"{PLANE}/hacksaw.toml::pymunk",
    f"{PLANE}/hacksaw_recorded.toml::pymunk": f"{PLANE}/hacksaw.toml::pymunk",
    f"{PLANE}/change_point.toml::pymunk": f"{PLANE}/fourbar.toml::pymunk",
    # the counterparts require that no other channel of the case differs
    f"{PLANE}/hacksaw_cutting.toml::pymunk": (
        f"{MUTATIONS}_load_on_the_slider_turns_the_holding_moment_alone[hacksaw_cutting"
    ),
    f"{PLANE}/inverted_slider_crank_forces.toml::pymunk": (
        f"{MUTATIONS}_mass_turns_what_knows_it_and_nothing_else[inverted_slider_crank_forces"
    ),
    f"{PLANE}/inverted_slider_crank_classic.toml::pymunk": (
        f"{PLANE}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANE}/threeprr.toml::pymunk": f"{PLANE}/threeprr_circle.toml::pymunk",
    f"{PLANE}/threeprr_second.toml::pymunk": f"{PLANE}/threeprr_circle.toml::pymunk",
    f"{PLANE}/chebyshev_lambda.toml::pymunk": f"{PLANE}/watt.toml::pymunk",
    f"{PLANE}/stephenson.toml::pymunk": f"{PLANE}/watt.toml::pymunk",
    f"{PLANE}/peaucellier.toml::pymunk": f"{PLANE}/watt.toml::pymunk",
    f"{PLANE}/gear_pair.toml::pymunk": (
        "tests/sim/test_gears.py::test_a_sweep_is_the_closed_form[pymunk"
    ),
    f"{PLANE}/andrews.toml::pymunk": (
        "tests/sim/test_point_springs.py::test_pymunk_is_of_second_order[springs"
    ),
    f"{PLANE}/hacksaw_forces.toml::pymunk": f"{PLANE}/slider_crank_forces.toml::pymunk",
    f"{PLANE}/fivebar_forces.toml::pymunk": f"{PLANE}/fourbar_forces.toml::pymunk",
    f"{PLANE}/threeprr_forces.toml::pymunk": f"{PLANE}/fourbar_forces.toml::pymunk",
    f"{PLANE}/shaft_pendulum.toml::pymunk": (
        "tests/sim/test_friction.py::test_stick_and_slip_change_in_the_sample_of_the_closed_form"
        "[pymunk"
    ),
    f"{PLANE}/fourbar_released.toml::mujoco:default": f"{PLANE}/pendulum.toml::mujoco:default",
    f"{PLANE}/hacksaw.toml::mujoco:fine": f"{SPACE}/changing_gear.toml::mujoco:fine",
    f"{SPACE}/slider_crank_spatial.toml::mujoco": f"{SPACE}/universal_joint.toml::mujoco",
    f"{SPACE}/bricard.toml::mujoco:default": f"{SPACE}/universal_joint.toml::mujoco:default",
    # balancers from one template
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
    f"{BALANCERS}/balancer_progressive_contact.toml::pymunk": f"{HELD}[contact",
    f"{BALANCERS}/balancer_progressive_locked.toml::pymunk": f"{HELD}[contact",
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
        f"{BALANCERS}/balancer_sine_free_preload.toml::pymunk"
    ),
    f"{BALANCERS}/balancer_third_preload.toml::pymunk": (
        f"{BALANCERS}/balancer_sine_free_preload.toml::pymunk"
    ),
    f"{BALANCERS}/balancer_extending.toml::pymunk": f"{EXTENSION}[change0",
    f"{BALANCERS}/balancer_sine_nonlinear.toml::pymunk": f"{HELD}[nonlinear",
    # rods
    f"{RODS}/rfr2_circles.toml": f"{FIRST_PLACES}[rfr2_circles",
    f"{RODS}/rfr2_rectangles.toml": f"{FIRST_PLACES}[rfr2_rectangles",
    f"{RODS}/rfr2_driven.toml::pymunk": (
        "tests/sim/test_rods_2rfr.py::test_a_motion_of_both_motors_is_that_of_the_chains[pymunk"
    ),
    f"{RODS}/pfr3.toml::pymunk": (
        "tests/sim/test_rods_platform.py::test_sliders_lead_the_platform[pymunk"
    ),
    f"{RODS}/rfr3.toml::pymunk": (
        "tests/sim/test_rods_platform.py::test_both_solutions_of_table_8_rest[pymunk-S1"
    ),
    f"{RODS}/rfr2_load_path.toml::pymunk": (
        "tests/sim/test_rods_2rfr.py::test_a_motion_of_both_motors_is_that_of_the_chains[pymunk"
    ),
    f"{RODS}/rod_released.toml::pymunk": (
        "tests/sim/test_rods_released.py::test_a_released_cantilever[pymunk"
    ),
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
    "tests/sim/test_changing_loads.py::test_a_load_along_a_path_is_the_load_of_each_place[rod": (
        "tests/sim/test_changing_loads.py::test_rods_of_the_path_meet_and_carry_the_load_of_their"
    ),
    "tests/sim/test_motion.py::test_poses_next_to_a_snap_are_among_few": SNAPS_LATER,
    "tests/sim/test_motion.py::test_a_mechanism_is_drawn_on_both_sides_of_its_snaps": SNAPS_LATER,
    "tests/sim/test_motion.py::test_the_reference_is_drawn_beyond_the_snap": SNAPS_LATER,
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
    "tests/sim/test_friction.py::test_every_friction_of_a_shipped_model_is_noticed"
    "[balancer_prototype-1-mujoco": (
        "tests/sim/test_friction.py::test_every_friction_of_a_shipped_model_is_noticed"
        "[balancer_prototype-0-mujoco"
    ),
    # files and output of commands, from whole runs
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
    f"{BENCHMARK}[rod]": f"{BENCHMARK}[rod_table2",
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
    # springs and controls
    "tests/sim/test_point_springs.py::test_pymunk_is_of_second_order[slack": (
        "tests/sim/test_point_springs.py::test_pymunk_is_of_second_order[springs"
    ),
    "tests/analytic/planar/test_planar_springs.py::test_the_spatial_reference_has_the_same_motion"
    "[0]": (
        "tests/analytic/planar/test_planar_springs.py"
        "::test_the_spatial_reference_has_the_same_motion[0.6"
    ),
    "tests/analytic/planar/test_planar_springs.py::test_the_spatial_reference_has_the_same_motion"
    "[0.2": (
        "tests/analytic/planar/test_planar_springs.py"
        "::test_the_spatial_reference_has_the_same_motion[0.6"
    ),
    "tests/sim/test_controls_in_time.py::test_the_shipped_case_agrees_in_both_engines": (
        f"{PLANE}/axes_controlled.toml::mujoco"
    ),
    # references of mechanisms in space, over their whole runs
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
    "tests/sim/test_rods_platform.py::test_a_mirrored_platform_differs": (
        "tests/sim/test_rods_platform.py::test_a_wrong_mechanism_differs[guide's direction"
    ),
    "tests/sim/test_rods_platform.py::test_the_misprinted_angle_does_not_agree": (
        "tests/analytic/rods/test_rod_platform.py::test_the_misprinted_angle_is_another_mechanism"
    ),
    "tests/analytic/rods/test_rod_continuation.py::test_rectangle_returns": (
        "tests/analytic/rods/test_rod_continuation.py::test_ring"
    ),
    "tests/analytic/rods/test_rod_platform.py::test_a_third_of_a_turn": (
        "tests/analytic/rods/test_rod_continuation.py::test_platform_follows_a_circle"
    ),
    "tests/studies/diet/test_diet_chart.py::test_model_and_filters_are_kept": (
        "tests/studies/stress/test_stress_chart.py::test_case_and_parameter_are_chosen_and_kept"
    ),
    "tests/analytic/rods/test_rod_continuation.py::test_sheet_and_loci_have_the_symmetry": (
        "tests/analytic/rods/test_rod_maps.py::test_direct_singularities_by_differences"
    ),
    "tests/analytic/rods/test_rod_continuation.py::test_straight_line_and_its_divisions": (
        "tests/analytic/rods/test_rod_continuation.py::test_ring"
    ),
    "tests/analytic/rods/test_rod_pair_driven.py::test_both_motors_lead_the_pin_round_a_ring": (
        "tests/analytic/rods/test_rod_pair_driven.py::test_turns_of_the_motors_join_the_equilibria"
    ),
    "tests/studies/trade/test_disturbed.py::test_a_disturbance_grows": (
        "tests/studies/trade/test_disturbed.py::test_a_chaotic_motion_is_told"
    ),
    "tests/test_new_from_model.py::test_a_model_with_sensors_is_not_copied": (
        "tests/test_new_from_model.py::test_a_drive_stays_clear_of_the_limit"
    ),
    f"{BENCHMARK}[limits": (
        "tests/studies/stress/test_stress_limits.py::test_a_limit_that_is_5_percent_off_is_found"
    ),
    f"{BENCHMARK}[notebooks": "tests/test_notebooks.py::test_a_notebook_runs[fourbar",
    "tests/studies/test_study_run.py::test_an_interrupt_from_the_keyboard_stores_no_crash": (
        "tests/studies/test_study_commands.py::test_an_interrupt_is_one_line_that_says_what_is_kept[trade"
    ),
    "tests/studies/trade/test_trade.py::test_an_order_that_the_reference_spoils_says_so": (
        "tests/studies/trade/test_trade_floor.py::test_a_reference_that_is_wrong_is_found"
    ),
    "tests/test_coverage.py::test_the_fourbar_leaves_the_inertia_of_its_steady_crank": (
        "tests/test_coverage.py::test_the_inertia_of_a_steady_crank_is_told_apart"
    ),
    "tests/test_examples.py::test_choose_a_setting": (
        "tests/test_examples_chosen.py::test_a_program_is_as_accurate_as_it_says[pendulum_mujoco"
    ),
    "tests/analytic/rods/test_rod_maps.py::test_triangles_fill_the_sheet_to_its_rim": (
        "tests/analytic/rods/test_rod_maps.py::test_triangles_of_both_signs_meet_at_the_singularity"
    ),
    "tests/analytic/rods/test_rod_snap.py::test_a_shallow_rod_snaps_where_a_beam_does": (
        "tests/analytic/rods/test_rod_snap.py::test_the_fold_is_where_shooting_is_singular"
    ),
    "tests/analytic/rods/test_rod_motion.py::test_a_stiff_coupler_is_a_rigid_one": (
        "tests/analytic/rods/test_rod_motion.py::test_an_elastic_coupler_is_the_limit_of_chains"
    ),
    "tests/analytic/rods/test_rod_taut.py::test_neighbours_share_a_search": (
        "tests/analytic/rods/test_rod_platform.py::test_neighbours_share_a_search"
    ),
    "tests/design/test_design_search.py::test_same_seed_same_design": (
        "tests/design/test_design_search.py::test_an_interrupted_search_gives_what_an_uninterrupted"
    ),
    "tests/studies/stress/test_stress_singular.py::test_a_stiff_spring_on_a_pendulum": (
        "tests/studies/stress/test_stress_bare.py::test_small_models_have_the_limits_of_theory"
    ),
    f"{RODS}/rod_snap.toml::mujoco:settled": f"{SNAPS}[mujoco",
    f"{RODS}/rod_coil.toml::mujoco": f"{RODS}/rod_bend.toml::mujoco",
    f"{PLANE}/swinging_block_forces.toml::pymunk": f"{PLANE}/inverted_slider_crank.toml::pymunk",
    f"{RODS}/slider_crank_elastic.toml::mujoco": f"{RODS}/rod_released.toml::mujoco",
    f"{RODS}/rfr2_driven.toml::mujoco": (
        "tests/sim/test_rods_2rfr.py::test_a_motion_of_both_motors_is_that_of_the_chains[mujoco"
    ),
    f"{BENCHMARK}[modules_used_once": f"{BENCHMARK}[sweeping",
    f"{BENCHMARK}[contacts": f"{BENCHMARK}[sweeping",
    f"{BENCHMARK}[balancer]": f"{BENCHMARK}[sweeping",
    f"{BENCHMARK}[files_passed": f"{BENCHMARK}[sweeping",
    f"{BENCHMARK}[foreign": f"{BENCHMARK}[sweeping",
    f"{LENGTHS}[ball_bounces-height-pymunk": f"{LENGTHS}[balls_in_row-gap-pymunk",
    f"{LENGTHS}[balancer_sine_free_preload-pendulum-mujoco": (
        f"{LENGTHS}[balancer4_sam_prescribed-pendulum-mujoco"
    ),
    "tests/test_detectable.py::test_what_is_said_of_a_parameter_is_what_a_changed_one_does"
    "[balancer_progressive_locked": (
        "tests/test_detectable.py::test_what_is_said_of_a_parameter_is_what_a_changed_one_does"
        "[rod_cantilever"
    ),
    f"{RODS}/rod_taut.toml::mujoco": (
        "tests/sim/test_rods_taut.py::test_both_engines_sag_alike_and_symmetrically"
    ),
    # the pytest item of a sidecar validates its case first
    f"{VALID}[pfr3": f"{RODS}/pfr3.toml::mujoco",
    f"{VALID}[rfr3": f"{RODS}/rfr3.toml::mujoco",
    f"{RODS}/rod_follower.toml::pymunk": (
        "tests/sim/test_rods_loads.py::test_a_chain_under_all_loads_at_once"
    ),
    "tests/test_twin_engine.py::test_pytest_runs_the_twin": (
        "tests/test_twin_engine.py::test_check_agrees_with_the_twin_and_not_with_the_wrong_one"
    ),
    "tests/analytic/rods/test_rod_maps.py::test_the_aspect_of_a_stable_equilibrium_is_stable": (
        "tests/analytic/rods/test_rod_maps.py::test_triangles_of_both_signs_meet_at_the_singularity"
    ),
    "tests/analytic/rods/test_rod_solutions.py::test_random_starts_find_no_other": (
        "tests/analytic/rods/test_rod_solutions_bound.py::test_galerkin_method_finds_them_as_well"
    ),
}
SOME = {
    "tests/report/test_browser.py": {
        "test_every_channel_of_every_run_can_be_shown": ["rod_cantilever"],
    },
    "tests/report/test_pictures.py": {
        "test_a_first_screen_that_was_changed_is_told": ["a missing panel"],
    },
    "tests/report/test_views.py": {
        "test_springs_are_drawn_as_spirals": ["3"],
    },
    "tests/report/test_chart_figure.py": {
        "test_panels_are_a_grid_named_at_its_edges": ["1-grid0", "4-grid3", "5-grid4"],
    },
    "tests/report/test_index_browser.py": {
        "test_a_third_engine_has_room_beside_the_others": ["390", "1280"],
    },
    "tests/analytic/planar/test_andrews.py": {
        "test_a_number_wrong_in_its_fifth_digit_is_another_motion": ["4530.01"],
    },
    "tests/analytic/planar/test_planar_rests.py": {
        "test_a_snap_ends_a_path_wherever_the_samples_are": ["572"],
    },
    "tests/analytic/planar/test_planar_springs.py": {
        "test_polynomial_springs_and_dampers_are_those_of_the_spatial_reference": ["True"],
    },
    "tests/analytic/rods/test_rod_continuation.py": {
        "test_unloading": ["S2"],
    },
    "tests/analytic/rods/test_spatial_rod.py": {
        "test_a_helix_under_a_wrench_along_its_axis_is_another_helix": ["0.9-2.9"],
        "test_a_formulation_by_strains_in_which_no_moment_is_integrated": ["natural0", "natural3"],
        "test_in_its_plane_it_is_the_planar_rod": ["strains0-force", "strains1-weight"],
    },
    "tests/sim/test_rods_in_space.py": {
        "test_a_wrong_number_of_the_rod_differs": ["torsion = 0.0083"],
    },
    "tests/analytic/rods/test_rod_platform.py": {
        "test_shooting_finds_the_same": ["load0"],
    },
    "tests/analytic/rods/test_rod_cosserat.py": {
        "test_shooting_in_the_frame_of_the_sections": ["weight and force", "shear"],
    },
    "tests/analytic/rods/test_rod_shooting.py": {
        "test_guess_selects_the_branch": ["document", "exact-guess0"],
        "test_shooting_converges_quadratically": ["0", "1"],
    },
    "tests/analytic/rods/test_rod_snap.py": {
        "test_shapes_are_rods_from_the_clamp_to_the_pin": ["0.5", "0.8"],
        "test_the_fold_is_where_shooting_is_singular": ["0.5", "0.8"],
        "test_each_fold_adds_a_direction_to_fall_in": ["0.5", "0.8"],
        "test_beyond_the_fold_one_rest_is_left": ["54.338"],
    },
    "tests/analytic/rods/test_rod_solutions.py": {
        "test_every_known_equilibrium_is_found_with_its_energy_and_stability": ["rfr2", "unloaded"],
        "test_verified_by_shooting": ["rfr2", "rfr3"],
    },
    "tests/analytic/rods/test_rod_cantilever.py": {
        "test_boundary_value_problem_by_collocation": ["load2"],
    },
    "tests/analytic/rods/test_rod_follower.py": {
        "test_shooting_in_the_frame_of_the_sections": ["load1"],
    },
    "tests/analytic/balancer/test_balancer_friction.py": {
        "test_postures_are_of_least_energy_and_dissipation": ["friction2"],
    },
    "tests/analytic/balancer/test_balancer_extension.py": {
        "test_engines_agree_and_another_extension_turns_the_verdict": ["change0", "change3"],
    },
    "tests/analytic/balancer/test_balancer.py": {
        "test_recomputed_curves": ["17", "20"],
    },
    "tests/analytic/balancer/test_balancer_grid.py": {
        "test_printed_results_of_four_segments": ["17", "20"],
    },
    "tests/analytic/balancer/test_balancer_lines.py": {
        "test_general_fitter_finds_nothing_better": ["sine-", "laevo-"],
    },
    "tests/analytic/balancer/test_balancer_posture.py": {
        "test_another_model_turns_the_verdict_in_both_engines": ["stiffness", "pos="],
    },
    "tests/analytic/balancer/test_spring_release.py": {
        "test_a_wrong_spring_or_contact_is_found": [
            "series-range",
            "series-stiffness",
            'parallel-springref="0.0405"',
        ],
    },
    "tests/analytic/planar/test_planar_free.py": {
        "test_parallelograms_pass_their_flat_poses_on_the_motion_of_a_pendulum": ["11", "321"],
    },
    "tests/analytic/linkages/test_threeprr_maps.py": {
        "test_aspects_are_where_the_inverse_problem_has_their_sign": ["--0.4-"],
        "test_type_2_is_a_zero_with_a_change_of_sign": ["--0.4-"],
    },
    "tests/design/test_design_search.py": {
        "test_an_interrupted_search_gives_what_an_uninterrupted_one_gives": ["2"],
    },
    "tests/design/test_design_synthesis.py": {
        "test_a_batch_is_worth_what_each_design_alone_is": [
            "1_1",
            "laevo 3 nonlinear",
            "laevo 4",
            "progressive",
            "sine180",
            "sine 3 linear standard -1",
        ],
    },
    "tests/studies/stress/test_stress_limits.py": {
        "test_several_boundaries_that_are_wrong_are_found": ["factors0"],
    },
    "tests/studies/stress/test_stress_theory.py": {
        "test_boundaries_are_where_theory_says": [
            "four-bar",
            "column",
            "loop",
            "hung",
            "servo",
            "discrete",
        ],
        "test_a_spring_that_is_not_the_one_of_the_theory_is_noticed": ["0.8"],
    },
    "tests/studies/stress/test_stress_singular.py": {
        "test_arms_reach_as_far_as_their_ends_are_apart": ["fourbar"],
    },
    "tests/studies/stress/test_stress.py": {
        "test_scaled_mechanisms_have_scaled_curves": [
            "sweep",
            "slider_crank-dynamics-3e-06-mujoco",
            "fourbar_released-dynamics-3e-06-pymunk",
        ],
    },
    "tests/studies/stress/test_stress_bare.py": {
        "test_small_models_have_the_limits_of_theory_in_the_engines_themselves": ["spring", "hung"],
        "test_time_steps_of_mujoco": ["RK4"],
    },
    "tests/studies/trade/test_program.py": {
        "test_a_program_gives_what_the_harness_gives": ["fourbar", "pendulum"],
        "test_the_program_of_a_fourbar_is_right": ["drive0", "drive1"],
    },
    "tests/studies/trade/test_program_rods.py": {
        "test_defaults_do_not_reach_the_links_of_a_program": ["defaults2"],
        "test_other_drives_move_rods": ["drive1"],
    },
    "tests/studies/trade/test_pymunk_program.py": {
        "test_a_program_does_what_simulate_does": ["fourbar", "hacksaw", "threeprr", "pendulum"],
    },
    "tests/test_diagnosis.py": {
        "test_the_planted_fault_is_the_first_cause": [
            "parameter",
            "fourbar-factor-holding_moment",
            "offset",
            "slider_crank-shift",
            "quantity",
        ],
    },
    "tests/test_compare.py": {
        "test_a_wrong_gear_ratio_is_found_by_a_constant_rate": ["-0.001"],
    },
    "tests/sim/test_limits.py": {
        "test_a_sweep_across_a_limit_position_stops_there": ["mujoco-fourbar", "pymunk-planar"],
    },
    "tests/sim/test_changing_loads.py": {
        "test_rates_under_a_load_that_grows_are_slopes_of_the_path": ["case0"],
        "test_a_four_bar_whose_rocker_is_loaded_more_and_more": ["to = 6.28"],
    },
    "tests/sim/test_rods_loads.py": {
        "test_another_load_is_noticed": ["load = [4.1", "load = .*", "gear=", "refsite"],
    },
    "tests/sim/test_recorded.py": {
        "test_rows_that_are_missing_are_named": ["rows0", "rows1", "rows3"],
    },
    "tests/sim/test_rods_taut.py": {
        "test_a_wrong_rod_is_noticed": ["axial"],
    },
    "tests/sim/test_rods_strained.py": {
        "test_another_stiffness_of_the_rod_is_noticed": ["42.0", "19.0"],
    },
    "tests/sim/test_rods_driven.py": {
        "test_a_wrong_rod_is_found": ["1.02", "naive"],
    },
    "tests/sim/test_disable_flags.py": {
        "test_what_is_disabled_is_as_if_it_were_not_there": [
            "dynamics",
            "mujoco-sweep",
            "pymunk-sweep-spring",
            "pymunk-sweep-limit",
            "pymunk-sweep-frictionloss",
            "pymunk-sweep-equality",
            "mujoco-settled-equality",
            "mujoco-settled-limit",
            "mujoco-settled-actuation",
        ],
    },
    "tests/sim/test_engine_decides.py": {
        "test_springs_1_percent_stiffer_differ": [
            "balancer4_sam_prescribed",
            "balancer4_sine-sweep-mujoco:settled",
            "balancer4_sam-sweep",
            "balancer_sine-sweep-pymunk",
            "rfr2",
            "rod",
            "springs",
        ],
    },
    "tests/sim/test_numbers.py": {
        "test_a_change_is_where_it_was_meant_and_nowhere_else": [
            "fourbar",
            "balancer_sine_free_preload",
            "pendulum",
            "rfr2_natural",
        ],
    },
    "tests/sim/mujoco/test_mujoco.py": {
        "test_sweep_is_the_closed_form_to_rounding": ["fourbar"],
    },
    "tests/sim/mujoco/test_mujoco_settled.py": {
        "test_the_engine_settles_where_the_sweep_rests": ["contact", "four"],
    },
    "tests/sim/mujoco/test_written_settings.py": {
        "test_a_program_slides_as_the_product_s_own_run": ["settings1", "settings2"],
        "test_a_program_closes_its_loop_as_the_product_s_own_run": ["changed0"],
    },
    "tests/sim/pymunk/test_pymunk_statics.py": {
        "test_balancers_hold_the_moments_of_their_equilibria": ["nonlinear", "contact", "four"],
        "test_the_drive_holds_what_spring_1_takes_and_the_energy_gains": ["released", "four"],
        "test_down_again_is_as_up": ["four"],
    },
    "tests/sim/test_rods_platform.py": {
        "test_the_limit_of_many_links_is_the_rods": ["S1"],
        "test_sliders_lead_the_platform": ["pymunk"],
    },
    "tests/sim/pymunk/test_pymunk_stops.py": {
        "test_a_preload_presses_a_joint_on_its_stop_for_good": ["four"],
    },
    "tests/sim/test_friction.py": {
        "test_every_friction_of_a_shipped_model_is_noticed": [
            "mujoco",
            "shaft_pendulum-0-pymunk",
            "slider_crank_friction-1-pymunk",
        ],
    },
    "tests/test_mutations.py": {
        "test_a_wrong_inertia_turns_the_moment_of_a_drive": ["mujoco", "fourbar-1.30"],
        "test_a_wrong_mass_turns_what_knows_it_and_nothing_else": ["mujoco", '"1.5 0 0" mass'],
        "test_a_wrong_number_turns_the_motion_of_the_parallelograms": ["mujoco", "qpos"],
        "test_a_wrong_load_on_the_slider_turns_the_holding_moment_alone": [
            'slider_crank_offset-ctrl="0 -50"-ctrl="0 -50.001"-mujoco',
            'hacksaw_cutting-ctrl="0 10"-ctrl="0 10.001"-pymunk',
        ],
    },
}
"""Words in the parameters that run by default, by file and test; each test makes one claim."""
