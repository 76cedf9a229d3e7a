"""Names of tests that take seconds and get the marker ``slow``, with their faster counterparts.

`FASTER_TESTS` maps the beginning of the names of slow tests, including items of sidecars,
to the beginning of the name of a test that checks the same in less time.

`DEFAULT_PARAMETERS` has a list of words for each of some tests with parameters.  Those whose
parameters contain one of the words run by default; the others are slow.

`tests/conftest.py` sets the markers.  When all tests are collected, it refuses a row that marks no
test as slow, and a row whose counterpart or word matches no test or only slow tests.  Tests of all
shipped models choose their representatives in their own files.
"""

PLANAR = "models/linkages"
SPATIAL = "models/spatial"
BALANCERS = "models/balancers"
RODS = "models/rods"
FOUR_SEGMENTS_PYMUNK = f"{BALANCERS}/balancer4_sam_prescribed.toml::pymunk"
WRONG_NUMBER_TESTS = "tests/verdict/test_mutations.py::test_a_wrong"
LENGTH_TEST = "tests/verdict/test_mutations.py::test_a_length_wrong_by_three_times_its_detectable_change_differs"
EXTENSION_TEST = (
    "tests/analytic/balancer/test_balancer_extension.py"
    "::test_engines_agree_and_a_wrong_extension_differs"
)
HOLDING_MOMENT_TEST = (
    "tests/sim/pymunk/test_pymunk_statics.py::test_balancers_have_the_moments_of_their_equilibria"
)
SNAP_TEST = "tests/sim/test_rod_snap_engines.py::test_engines_snap_where_their_chain_does"
VALID_CASES_TEST = "tests/run/test_names_and_units.py::test_shipped_cases_are_valid"
LATER_SNAP = "tests/sim/test_motion.py::test_an_engine_that_snaps_later_is_drawn_on_its_own_side"
BENCHMARK_TEST = "tests/test_benchmarks.py::test_benchmark_runs_quickly_and_writes_no_documents"
PIN_START_TEST = (
    "tests/sim/test_rods_2rfr.py::test_the_pin_follows_the_published_circles_and_rectangles"
)
FASTER_TESTS = {
    "tests/sim/hosts/test_neutral_path.py::test_path_keeps_errors[andrews": (
        "tests/sim/hosts/test_neutral_path.py::test_path_keeps_errors[delta"
    ),
    "tests/sim/hosts/test_exact_engines.py::test_cases_agree[tower_crane-1e-08-pinocchio": (
        "tests/sim/hosts/test_exact_engines.py::test_cases_agree[tower_crane-1e-08-simbody"
    ),
    "tests/sim/hosts/test_rests.py::test_engines_come_to_rest[simbody": (
        "tests/sim/hosts/test_rests.py::test_engines_come_to_rest[dart"
    ),
    "tests/sim/hosts/test_rests.py::test_engines_come_to_rest[pinocchio": (
        "tests/sim/hosts/test_rests.py::test_engines_come_to_rest[dart"
    ),
    "tests/sim/hosts/test_rests.py::test_a_joint_sticks_and_slips_on_its_way": (
        "tests/sim/hosts/test_impulse_engines.py::test_a_joint_sticks_and_slips_in_a_sweep[dart"
    ),
    "tests/sim/hosts/test_drake.py::test_dry_friction_is_a_motor_with_a_limit": (
        "tests/sim/hosts/test_drake.py::test_a_loop_is_solved_with_first_order"
    ),
    "tests/evidence/test_diagnosis.py::test_the_setting_that_decides_is_named[default": (
        "tests/evidence/test_diagnosis.py::test_the_setting_that_decides_is_named[game"
    ),
    "tests/sim/test_engine_decides.py::test_an_engine_that_does_nothing_never_agrees[tumbling_box-dynamics-mujoco": (
        "tests/sim/test_engine_decides.py::test_an_engine_that_does_nothing_never_agrees[block_slides"
    ),
    "tests/reference/test_self_consistency.py"
    "::test_with_contacts_steps_of_one_evaluation_are_cheaper_than_rk4": (
        "tests/reference/test_self_consistency.py"
        "::test_the_cheapest_way_in_evaluations_is_found_without_trying_dearer_ones"
    ),
    "tests/sim/test_rods_in_space.py::test_a_wrong_stiffness_about_z_differs": (
        "tests/sim/test_rods_in_space.py::test_each_axis_bends_with_its_own_stiffness"
    ),
    # pymunk solves each pose of a sweep anew: it runs one linkage of each kind, MuJoCo runs all
    f"{PLANAR}/fivebar.toml::pymunk": f"{PLANAR}/fivebar_regular.toml::pymunk",
    f"{PLANAR}/fivebar_down.toml::pymunk": f"{PLANAR}/fivebar_regular.toml::pymunk",
    f"{PLANAR}/fivebar_equal.toml::pymunk": f"{PLANAR}/fivebar_regular.toml::pymunk",
    f"{PLANAR}/fivebar_circle.toml::pymunk": f"{PLANAR}/fivebar_regular.toml::pymunk",
    f"{PLANAR}/fivebar_rectangle.toml::pymunk": f"{PLANAR}/fivebar_regular.toml::pymunk",
    f"{PLANAR}/double_crank.toml::pymunk": f"{PLANAR}/fourbar.toml::pymunk",
    f"{PLANAR}/double_crank_crossed.toml::pymunk": f"{PLANAR}/fourbar.toml::pymunk",
    f"{PLANAR}/double_rocker.toml::pymunk": f"{PLANAR}/triple_rocker.toml::pymunk",
    f"{PLANAR}/fourbar_crossed.toml::pymunk": f"{PLANAR}/fourbar.toml::pymunk",
    f"{PLANAR}/inverted_slider_crank_equal.toml::pymunk": (
        f"{PLANAR}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANAR}/inverted_slider_crank_faster.toml::pymunk": (
        f"{PLANAR}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANAR}/inverted_slider_crank_held.toml::pymunk": (
        f"{PLANAR}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANAR}/slider_crank_mirrored.toml::pymunk": f"{PLANAR}/slider_crank.toml::pymunk",
    f"{PLANAR}/slider_crank_inclined.toml::pymunk": f"{PLANAR}/slider_crank.toml::pymunk",
    f"{PLANAR}/slider_crank_offset.toml::pymunk": f"{PLANAR}/slider_crank.toml::pymunk",
    f"{PLANAR}/hacksaw_sampled.toml::pymunk": f"{PLANAR}/slider_crank.toml::pymunk",
    f"{PLANAR}/hacksaw_inventor_shaped.toml::pymunk": f"{PLANAR}/slider_crank.toml::pymunk",
    f"{PLANAR}/hacksaw_recorded.toml::pymunk": f"{PLANAR}/slider_crank.toml::pymunk",
    f"{PLANAR}/hacksaw.toml::pymunk": f"{PLANAR}/slider_crank.toml::pymunk",
    f"{PLANAR}/finger.toml::pymunk": f"{PLANAR}/watt.toml::pymunk",
    f"{PLANAR}/change_point.toml::pymunk": f"{PLANAR}/fourbar.toml::pymunk",
    # the counterparts require that no other channel of the case differs
    f"{PLANAR}/hacksaw_cutting.toml::pymunk": (
        "tests/verdict/test_mutations.py::test_a_wrong_load_on_the_slider_changes_the_holding_moment_alone[hacksaw_cutting"
    ),
    f"{PLANAR}/inverted_slider_crank_forces.toml::pymunk": (
        "tests/verdict/test_mutations.py::test_a_wrong_mass_changes_the_channels_that_depend_on_it_alone[inverted_slider_crank_forces"
    ),
    f"{PLANAR}/inverted_slider_crank_classic.toml::pymunk": (
        f"{PLANAR}/inverted_slider_crank.toml::pymunk"
    ),
    f"{PLANAR}/threeprr.toml::pymunk": f"{PLANAR}/threeprr_circle.toml::pymunk",
    f"{PLANAR}/threeprr_second.toml::pymunk": f"{PLANAR}/threeprr_circle.toml::pymunk",
    f"{PLANAR}/chebyshev_lambda.toml::pymunk": f"{PLANAR}/watt.toml::pymunk",
    f"{PLANAR}/stephenson.toml::pymunk": f"{PLANAR}/watt.toml::pymunk",
    f"{PLANAR}/peaucellier.toml::pymunk": f"{PLANAR}/watt.toml::pymunk",
    f"{PLANAR}/gear_pair.toml::pymunk": (
        "tests/sim/test_gears.py::test_a_sweep_is_the_closed_form[pymunk"
    ),
    f"{PLANAR}/andrews.toml::pymunk": (
        "tests/sim/test_point_springs.py::test_point_springs_in_pymunk_are_of_second_order[springs"
    ),
    f"{PLANAR}/hacksaw_forces.toml::pymunk": f"{PLANAR}/slider_crank_forces.toml::pymunk",
    f"{PLANAR}/fivebar_forces.toml::pymunk": f"{PLANAR}/fourbar_forces.toml::pymunk",
    f"{PLANAR}/threeprr_forces.toml::pymunk": f"{PLANAR}/fourbar_forces.toml::pymunk",
    f"{PLANAR}/shaft_pendulum.toml::pymunk": (
        "tests/sim/test_friction.py::test_stick_and_slip_change_in_the_sample_of_the_closed_form"
        "[pymunk"
    ),
    f"{PLANAR}/fourbar_released.toml::mujoco": f"{PLANAR}/pendulum.toml::mujoco",
    f"{PLANAR}/hacksaw_forces.toml::mujoco": f"{PLANAR}/slider_crank_forces.toml::mujoco",
    f"{PLANAR}/andrews.toml::mujoco": (
        "tests/sim/test_point_springs.py::test_mujoco_has_dampers_and_slack_springs"
    ),
    "models/contacts/tumbling_box.toml::mujoco": (
        "tests/sim/mujoco/test_refined.py::test_steps_that_are_six_times_as_long_differ"
    ),
    f"{PLANAR}/hacksaw.toml::mujoco:fine": f"{SPATIAL}/changing_gear.toml::mujoco:fine",
    f"{SPATIAL}/slider_crank_spatial.toml::mujoco": f"{SPATIAL}/universal_joint.toml::mujoco",
    f"{SPATIAL}/flyball_governor.toml::mujoco": (
        "tests/analytic/spatial/test_flyball_governor.py::test_the_model_in_mujoco_moves_as_the_equations"
    ),
    f"{SPATIAL}/bricard.toml::mujoco:default": f"{SPATIAL}/universal_joint.toml::mujoco:default",
    # balancers from one template
    f"{BALANCERS}/balancer4_sam_shaped.toml::pymunk": FOUR_SEGMENTS_PYMUNK,
    f"{BALANCERS}/balancer4_sam.toml::pymunk": FOUR_SEGMENTS_PYMUNK,
    f"{BALANCERS}/balancer4_sine.toml::pymunk": FOUR_SEGMENTS_PYMUNK,
    f"{BALANCERS}/balancer4_sine.toml::mujoco:settled": (
        f"{BALANCERS}/balancer_sine_free_preload.toml::mujoco:settled"
    ),
    f"{BALANCERS}/balancer_designed.toml::pymunk": f"{BALANCERS}/balancer_sine.toml::pymunk",
    f"{BALANCERS}/balancer_designed_laevo.toml::pymunk": f"{BALANCERS}/balancer_sine.toml::pymunk",
    f"{BALANCERS}/balancer_laevo.toml::pymunk": f"{BALANCERS}/balancer_sine.toml::pymunk",
    f"{BALANCERS}/balancer_progressive_contact.toml::mujoco:settled": (
        f"{BALANCERS}/balancer_sine_free_preload.toml::mujoco:settled"
    ),
    f"{BALANCERS}/balancer_progressive_contact.toml::pymunk": f"{HOLDING_MOMENT_TEST}[contact",
    f"{BALANCERS}/balancer_progressive_locked.toml::pymunk": f"{HOLDING_MOMENT_TEST}[contact",
    f"{BALANCERS}/balancer_prototype.toml::pymunk": (
        "tests/sim/test_friction.py::test_the_prototype_with_friction_agrees_in_pymunk"
    ),
    f"{BALANCERS}/balancer_prototype.toml::mujoco": (
        "tests/sim/test_friction.py::test_the_loop_area_of_the_prototype_is_friction_times_travel"
        "[mujoco"
    ),
    f"{BALANCERS}/balancer_sine180.toml::mujoco": f"{BALANCERS}/balancer_sine.toml::mujoco",
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
    f"{BALANCERS}/balancer_extending.toml::pymunk": f"{EXTENSION_TEST}[change0",
    f"{BALANCERS}/balancer_sine_nonlinear.toml::pymunk": f"{HOLDING_MOMENT_TEST}[nonlinear",
    # rods
    f"{RODS}/rfr2_circles.toml": f"{PIN_START_TEST}[rfr2_circles",
    f"{RODS}/rfr2_line.toml": f"{RODS}/rfr2_motor_line.toml::mujoco",
    f"{RODS}/pfr3_line.toml": f"{RODS}/rfr2_motor_line.toml::mujoco",
    f"{RODS}/rfr3_path.toml::pymunk": f"{RODS}/rfr3_path.toml::mujoco",
    f"{RODS}/rfr2_rectangles.toml": f"{PIN_START_TEST}[rfr2_rectangles",
    f"{RODS}/rfr2_driven.toml::pymunk": (
        "tests/sim/test_rods_2rfr.py::test_poses_along_a_path_of_both_motors_are_chain_equilibria[pymunk"
    ),
    f"{RODS}/pfr3.toml::pymunk": (
        "tests/sim/test_rods_platform.py::test_poses_of_a_driven_platform_are_chain_equilibria[pymunk"
    ),
    f"{RODS}/rfr3.toml::pymunk": (
        "tests/sim/test_rods_platform.py::test_both_solutions_of_table_8_are_equilibria[pymunk-S1"
    ),
    f"{RODS}/rfr2_load_path.toml::pymunk": (
        "tests/sim/test_rods_2rfr.py::test_poses_along_a_path_of_both_motors_are_chain_equilibria[pymunk"
    ),
    f"{RODS}/rod_released.toml::pymunk": (
        "tests/sim/test_rods_released.py::test_a_released_cantilever_converges_with_order_2[pymunk"
    ),
    f"{RODS}/rfr2_missed.toml::pymunk": f"{RODS}/rfr2_natural.toml::pymunk",
    f"{RODS}/rod_into_circle.toml::pymunk": f"{RODS}/rod_cantilever.toml::pymunk",
    f"{RODS}/rod_wind.toml::pymunk": f"{RODS}/rod_cantilever.toml::pymunk",
    f"{RODS}/rod_sheared.toml::pymunk": (
        "tests/sim/test_rods_strained.py::test_a_strained_cantilever_rests_where_its_chain_does"
        "[half-both-pymunk"
    ),
    f"{RODS}/rod_taut.toml::pymunk": (
        "tests/sim/test_rods_taut.py::test_taut_rods_sag_equally_in_both_engines"
    ),
    f"{RODS}/rod_snap.toml::pymunk": f"{SNAP_TEST}[pymunk",
    f"{RODS}/slider_crank_elastic.toml::pymunk": (
        "tests/sim/test_rods_in_motion.py::test_an_elastic_coupler_in_pymunk_converges_with_order_2"
    ),
    "tests/sim/test_rods_in_motion.py::test_wrong_numbers_of_moving_rods_differ[slider_crank_elastic": (
        "tests/sim/test_rods_in_motion.py::test_wrong_numbers_of_moving_rods_differ[rod_released"
    ),
    "tests/sim/test_rods_in_space.py::test_errors_fall_with_the_square_of_the_links[strains1": (
        "tests/sim/test_rods_in_space.py::test_errors_fall_with_the_square_of_the_links[strains0"
    ),
    "tests/reference/test_twin_reference.py::test_trade_and_choose_measure_against_it[twin.py": (
        "tests/reference/test_twin_reference.py::test_trade_and_choose_measure_against_it[twin]"
    ),
    "tests/sim/test_rods_2rfr.py::test_motors_lead_the_pin_along_the_published_paths": (
        f"{PIN_START_TEST}[rfr2_circles"
    ),
    "tests/sim/test_rods_2rfr.py::test_beyond_its_fold_the_pair_snaps": f"{SNAP_TEST}[pymunk",
    "tests/sim/test_rods_driven.py::test_a_turning_motor_leads_the_pin_along_the_reference_path": (
        "tests/sim/test_rods_2rfr.py::test_poses_along_a_path_of_both_motors_are_chain_equilibria[mujoco"
    ),
    "tests/sim/test_rod_flex.py::test_a_flex_that_is_stiffer_or_longer_differs": (
        "tests/sim/test_engine_decides.py::test_springs_1_percent_stiffer_differ[rod_flex"
    ),
    "tests/sim/test_rods.py::test_a_cantilever_of_links_converges_with_order_2[5-pymunk": (
        "tests/sim/test_rods.py::test_a_cantilever_of_links_converges_with_order_2[2-pymunk"
    ),
    "tests/sim/test_rods.py::test_a_cantilever_of_links_converges_with_order_2[10-pymunk": (
        "tests/sim/test_rods.py::test_a_cantilever_of_links_converges_with_order_2[2-pymunk"
    ),
    "tests/sim/test_rods.py::test_all_stable_equilibria_of_a_pair[S1-pymunk": (
        "tests/sim/test_rods.py::test_all_stable_equilibria_of_a_pair[S2-pymunk"
    ),
    "tests/sim/test_rods.py::test_all_stable_equilibria_of_a_pair[S3-pymunk": (
        "tests/sim/test_rods.py::test_all_stable_equilibria_of_a_pair[S2-pymunk"
    ),
    "tests/sim/test_changing_loads.py::test_curves_under_a_changing_load_are_those_of_each_constant_load[rod": (
        "tests/sim/test_changing_loads.py::test_rods_under_a_changing_load_meet_at_the_pin"
    ),
    "tests/sim/test_motion.py::test_a_few_drawn_poses_include_those_next_to_a_snap": LATER_SNAP,
    "tests/sim/test_motion.py::test_a_mechanism_is_drawn_on_both_sides_of_its_snaps": LATER_SNAP,
    "tests/sim/test_motion.py::test_the_reference_is_drawn_beyond_the_snap": LATER_SNAP,
    "tests/sim/test_rods_strained.py::test_a_strained_rod_under_its_weight_converges_with_order_2[shear-pymunk": (
        "tests/sim/test_rods_strained.py::test_a_strained_rod_under_its_weight_converges_with_order_2[axial-pymunk"
    ),
    "tests/sim/test_rods_strained.py::test_a_strained_rod_under_its_weight_converges_with_order_2[both-pymunk": (
        "tests/sim/test_rods_strained.py::test_a_strained_rod_under_its_weight_converges_with_order_2[axial-pymunk"
    ),
    "tests/sim/test_changing_loads.py::test_a_platform_under_a_growing_load_converges_with_order_2": (
        f"{RODS}/rfr2_load_path.toml::mujoco"
    ),
    "tests/sim/test_rods_2rfr.py::test_a_wrong_pair_of_rods_differs": (
        "tests/sim/test_engine_decides.py::test_springs_1_percent_stiffer_differ[rfr2_natural"
    ),
    "tests/sim/test_numbers.py::test_a_change_acts_on_its_number_only[rfr3": (
        "tests/sim/test_numbers.py::test_a_change_acts_on_its_number_only[rfr2_natural"
    ),
    "tests/sim/test_rod_snap_engines.py::test_a_sweep_without_time_ends_at_the_fold": (
        "tests/sim/test_rods_2rfr.py::test_a_sweep_ends_at_the_fold_of_its_chains"
    ),
    "tests/sim/test_friction.py::test_every_friction_that_is_0_1_percent_larger_differs"
    "[shaft_pendulum-1-pymunk": (
        "tests/sim/test_friction.py::test_every_friction_that_is_0_1_percent_larger_differs"
        "[shaft_pendulum-0-pymunk"
    ),
    "tests/sim/test_friction.py::test_the_loop_area_of_the_shaft_equals_the_closed_form[pymunk": (
        "tests/sim/test_friction.py::test_stick_and_slip_change_in_the_sample_of_the_closed_form"
        "[pymunk"
    ),
    "tests/verdict/test_mutations.py::test_a_wrong_number_changes_the_motion_of_the_parallelograms[pos": (
        "tests/verdict/test_mutations.py::test_a_wrong_number_changes_the_motion_of_the_parallelograms[qpos"
    ),
    f"{LENGTH_TEST}[shaft_pendulum-length-pymunk": (
        "tests/sim/test_friction.py::test_every_friction_that_is_0_1_percent_larger_differs"
        "[shaft_pendulum-0-pymunk"
    ),
    f"{LENGTH_TEST}[fivebar-left_crank-pymunk": f"{LENGTH_TEST}[fourbar-crank-pymunk",
    f"{LENGTH_TEST}[hacksaw-crank-pymunk": f"{LENGTH_TEST}[slider_crank-crank-pymunk",
    f"{LENGTH_TEST}[inverted_slider_crank_classic-crank-pymunk": (
        f"{LENGTH_TEST}[inverted_slider_crank-crank-pymunk"
    ),
    f"{LENGTH_TEST}[balancer_sine_free_preload-pendulum-pymunk": (
        f"{LENGTH_TEST}[balancer4_sam_prescribed-pendulum-pymunk"
    ),
    "tests/sim/test_friction.py::test_every_friction_that_is_0_1_percent_larger_differs"
    "[balancer_prototype-1-mujoco": (
        "tests/sim/test_friction.py::test_every_friction_that_is_0_1_percent_larger_differs"
        "[balancer_prototype-0-mujoco"
    ),
    # files and output of commands, from whole runs
    "tests/base/test_worker.py::test_a_deeply_nested_sidecar_does_not_affect_other_cases[tables": (
        "tests/base/test_worker.py::test_a_deeply_nested_sidecar_does_not_affect_other_cases[arrays"
    ),
    "tests/base/test_worker.py::test_a_reference_that_takes_too_long_does_not_affect_other_cases": (
        "tests/base/test_worker.py::test_a_model_that_is_too_large_does_not_affect_other_cases"
    ),
    "tests/run/test_same_digits.py::test_check_gives_the_same_digits_with_any_number_of_threads_and_jobs": (
        "tests/run/test_same_digits.py::test_workers_solve_equations_to_the_same_bits"
    ),
    "tests/evidence/test_diagnosis.py::test_a_number_of_the_model_is_named_where_the_reference_has_none": (
        "tests/evidence/test_diagnosis.py::test_a_longer_rocker_whose_centre_of_mass_stays_is_named"
    ),
    "tests/evidence/test_diagnosis.py::test_a_failed_pytest_item_states_the_cause": (
        "tests/commands/test_command_line.py::test_an_item_fails_where_check_would_and_says_why"
    ),
    "tests/evidence/test_diagnosis.py::test_a_wrong_number_is_named_as_one_of_the_model[balancer_sine": (
        "tests/evidence/test_diagnosis.py::test_a_wrong_number_is_named_as_one_of_the_model[slider_crank"
    ),
    "tests/teaching/test_notebooks.py::test_a_notebook_runs[hacksaw": (
        "tests/teaching/test_notebooks.py::test_a_notebook_runs[fourbar"
    ),
    "tests/test_examples_chosen.py::test_rates_of_the_formulas_are_derivatives[fourbar_released": (
        "tests/test_examples_chosen.py::test_rates_of_the_formulas_are_derivatives"
    ),
    f"{BENCHMARK_TEST}[rod]": f"{BENCHMARK_TEST}[rod_table2",
    "tests/report/test_report.py::test_drawing_has_the_names_of_the_mjcf[hacksaw": (
        "tests/report/test_report.py::test_drawing_has_the_names_of_the_mjcf[fivebar"
    ),
    "tests/studies/trade/test_trade_floor.py::test_a_bias_is_found_by_removing_it_with_enough_iterations": (
        "tests/studies/trade/test_trade_floor.py::test_halving_the_bias_or_the_step_halves_the_error_of_the_bias"
    ),
    "tests/studies/trade/test_trade_floor.py::test_segments_of_a_rod_in_motion_are_found": (
        "tests/studies/trade/test_trade_floor.py::test_segments_of_a_rod_are_found"
    ),
    "tests/studies/diet/test_diet_bare.py::test_the_time_step_is_as_long_as_the_error_allows": (
        "tests/studies/diet/test_diet_models.py::test_a_longer_step_is_compared_with_the_reference"
    ),
    # pages in a browser
    "tests/studies/diet/test_diet_chart.py::test_axe_finds_no_accessibility_violation[dark": (
        "tests/studies/diet/test_diet_chart.py::test_axe_finds_no_accessibility_violation[light"
    ),
    "tests/studies/stress/test_stress_chart.py::test_axe_finds_no_accessibility_violation[dark": (
        "tests/studies/stress/test_stress_chart.py::test_axe_finds_no_accessibility_violation[light"
    ),
    "tests/studies/test_study_pages_browser.py::test_axe_finds_no_accessibility_violation[trade/fourbar-dynamics"
    "-trade.html-dark": (
        "tests/studies/test_study_pages_browser.py::test_axe_finds_no_accessibility_violation[stress/index.html-dark"
    ),
    # springs and controls
    "tests/sim/test_point_springs.py::test_point_springs_in_pymunk_are_of_second_order[slack": (
        "tests/sim/test_point_springs.py::test_point_springs_in_pymunk_are_of_second_order[springs"
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
        f"{PLANAR}/axes_controlled.toml::mujoco"
    ),
    # references of mechanisms in space, over their whole runs
    "tests/analytic/spatial/test_spatial_loops.py::test_a_spatial_slider_crank_agrees_with_a_quadrature[5.0": (
        "tests/analytic/spatial/test_spatial_loops.py::test_a_spatial_slider_crank_agrees_with_a_quadrature[0.5"
    ),
    "tests/analytic/spatial/test_spatial_loops.py::test_bricards_linkage_agrees_with_its_equation_of_motion[10": (
        "tests/analytic/spatial/test_spatial_loops.py::test_bricards_linkage_agrees_with_its_equation_of_motion[2.0"
    ),
    "tests/analytic/spatial/test_spatial_tops.py::test_a_heavy_top_agrees_with_elliptic_functions[2.0": (
        "tests/analytic/spatial/test_spatial_tops.py::test_a_heavy_top_agrees_with_elliptic_functions[0.2"
    ),
    # references of rods
    "tests/analytic/rods/test_rod_solutions_bound.py::test_galerkins_method_finds_the_equilibria_under_large_loads"
    "[rfr3-1-230": (
        "tests/analytic/rods/test_rod_solutions_bound.py::test_galerkins_method_finds_the_equilibria_under_large_loads"
        "[rfr3-1-170"
    ),
    "tests/analytic/rods/test_rod_pair_driven.py::test_four_rectangles_of_the_document": (
        "tests/analytic/rods/test_rod_pair_driven.py::test_turns_of_the_motors_join_the_equilibria"
    ),
    "tests/analytic/rods/test_rod_pair_driven.py::test_five_circles_of_the_document": (
        "tests/analytic/rods/test_rod_pair_driven.py::test_turns_of_the_motors_join_the_equilibria"
    ),
    "tests/analytic/rods/test_rod_cantilever.py::test_every_branch_is_an_equilibrium_and_their_number_is_odd[load3": (
        "tests/analytic/rods/test_rod_cantilever.py::test_every_branch_is_an_equilibrium_and_their_number_is_odd[load0"
    ),
    "tests/analytic/rods/test_rod_cantilever.py::test_potential_by_virtual_work[load2": (
        "tests/analytic/rods/test_rod_cantilever.py::test_potential_by_virtual_work[load0"
    ),
    "tests/sim/test_rods_platform.py::test_a_mirrored_platform_differs": (
        "tests/sim/test_rods_platform.py::test_a_wrong_mechanism_differs[guide's direction"
    ),
    "tests/sim/test_rods_platform.py::test_the_misprinted_angle_differs": (
        "tests/analytic/rods/test_rod_platform.py::test_the_misprinted_angle_is_another_mechanism"
    ),
    "tests/analytic/rods/test_rod_continuation.py::test_the_path_of_a_rectangle_closes": (
        "tests/analytic/rods/test_rod_continuation.py::test_motor_angles_along_a_ring_are_the_recomputed_ones"
    ),
    "tests/analytic/rods/test_rod_platform.py::test_rotated_load_and_slides_rotate_the_pose": (
        "tests/analytic/rods/test_rod_continuation.py::test_platform_follows_a_circle"
    ),
    "tests/studies/diet/test_diet_chart.py::test_model_and_filters_are_kept_in_the_address": (
        "tests/studies/stress/test_stress_chart.py::test_case_and_parameter_are_kept_in_the_address"
    ),
    "tests/analytic/rods/test_rod_continuation.py::test_manifold_and_singularities_have_the_symmetry_of_the_mechanism": (
        "tests/analytic/rods/test_rod_maps.py::test_direct_singularities_by_differences"
    ),
    "tests/analytic/rods/test_rod_continuation.py::test_motor_angles_along_a_line_do_not_depend_on_the_stride": (
        "tests/analytic/rods/test_rod_continuation.py::test_motor_angles_along_a_ring_are_the_recomputed_ones"
    ),
    "tests/analytic/rods/test_rod_pair_driven.py::test_both_motors_lead_the_pin_round_a_ring": (
        "tests/analytic/rods/test_rod_pair_driven.py::test_turns_of_the_motors_join_the_equilibria"
    ),
    "tests/studies/trade/test_disturbed.py::test_a_disturbance_grows_by_the_equations_of_motion": (
        "tests/studies/trade/test_disturbed.py::test_a_chaotic_motion_has_a_rate_and_a_horizon"
    ),
    "tests/commands/test_new_from_model.py::test_a_model_with_sensors_is_not_copied": (
        "tests/commands/test_new_from_model.py::test_a_proposed_drive_stays_clear_of_its_limit_position"
    ),
    f"{BENCHMARK_TEST}[limits": (
        "tests/studies/stress/test_stress_limits.py::test_a_limit_that_is_5_percent_off_is_found"
    ),
    f"{BENCHMARK_TEST}[notebooks": "tests/teaching/test_notebooks.py::test_a_notebook_runs[fourbar",
    "tests/studies/test_study_run.py::test_an_interrupt_from_the_keyboard_stores_no_crash": (
        "tests/studies/test_study_commands.py::test_an_interrupt_prints_one_line_about_what_is_kept[trade"
    ),
    "tests/studies/trade/test_trade.py::test_an_order_that_is_limited_by_the_reference_has_a_remark": (
        "tests/studies/trade/test_trade_floor.py::test_a_wrong_reference_is_found_as_the_cause"
    ),
    "tests/evidence/test_coverage.py::test_the_fourbar_leaves_the_inertia_of_its_steady_crank": (
        "tests/evidence/test_coverage.py::test_a_steady_drive_is_a_reason_for_the_inertia_of_its_crank_only"
    ),
    "tests/test_examples_chosen.py::test_a_program_written_here_is_as_accurate_as_it_says[double_pendulum": (
        "tests/test_examples_chosen.py::test_a_program_is_as_accurate_as_it_says[pendulum_mujoco"
    ),
    "tests/test_examples_chosen.py::test_a_program_written_here_is_as_accurate_as_it_says[fourbar_servo": (
        "tests/test_examples_chosen.py::test_a_program_is_as_accurate_as_it_says[fourbar_mujoco"
    ),
    "tests/test_examples_chosen.py::test_a_program_written_here_is_as_accurate_as_it_says[spring_slider": (
        "tests/test_examples_chosen.py::test_a_program_is_as_accurate_as_it_says[pendulum_mujoco"
    ),
    "tests/test_examples_chosen.py::test_a_program_written_here_is_as_accurate_as_it_says[fivebar_swing": (
        "tests/test_examples_chosen.py::test_a_program_is_as_accurate_as_it_says[slider_crank_pymunk"
    ),
    "tests/test_examples_chosen.py::test_a_program_written_here_is_as_accurate_as_it_says[jansen": (
        "tests/test_examples_chosen.py::test_a_program_is_as_accurate_as_it_says[fourbar_mujoco"
    ),
    # Pinocchio closes loops that are driven there, and is no second time started
    "tests/sim/hosts/test_witness.py::test_references_are_confirmed[fourbar": (
        "tests/sim/hosts/test_exact_engines.py::test_pinocchio_closes_driven_loops_to_rounding[hacksaw_sampled"
    ),
    "tests/test_examples.py::test_choose_a_setting_keeps_the_energy_of_a_pendulum": (
        "tests/test_examples_chosen.py::test_a_program_is_as_accurate_as_it_says[pendulum_mujoco"
    ),
    "tests/analytic/rods/test_rod_maps.py::test_triangles_fill_the_map_to_its_rim": (
        "tests/analytic/rods/test_rod_maps.py::test_triangles_of_both_signs_meet_at_the_singularity"
    ),
    "tests/analytic/rods/test_rod_snap.py::test_a_shallow_rod_snaps_where_a_beam_does": (
        "tests/analytic/rods/test_rod_snap.py::test_the_fold_is_where_shooting_is_singular"
    ),
    "tests/analytic/rods/test_rod_motion.py::test_a_stiff_coupler_moves_like_a_rigid_one": (
        "tests/analytic/rods/test_rod_motion.py::test_an_elastic_coupler_is_the_limit_of_chains"
    ),
    "tests/analytic/rods/test_rod_taut.py::test_neighbours_share_a_search": (
        "tests/analytic/rods/test_rod_platform.py::test_neighbours_share_a_search"
    ),
    "tests/design/test_design_search.py::test_the_same_seed_gives_the_same_design": (
        "tests/design/test_design_search.py::test_an_interrupted_search_has_the_result_of_an_uninterrupted_one"
    ),
    "tests/studies/stress/test_stress_singular.py::test_a_stiff_spring_on_a_pendulum": (
        "tests/studies/stress/test_stress_bare.py::test_bare_engines_have_the_limits_of_theory_in_small_models"
    ),
    f"{RODS}/rod_snap.toml::mujoco:settled": f"{SNAP_TEST}[mujoco",
    f"{RODS}/rod_coil.toml::mujoco": f"{RODS}/rod_bend.toml::mujoco",
    f"{PLANAR}/swinging_block_forces.toml::pymunk": f"{PLANAR}/inverted_slider_crank.toml::pymunk",
    f"{RODS}/slider_crank_elastic.toml::mujoco": f"{RODS}/rod_released.toml::mujoco",
    f"{RODS}/rfr2_driven.toml::mujoco": (
        "tests/sim/test_rods_2rfr.py::test_poses_along_a_path_of_both_motors_are_chain_equilibria[mujoco"
    ),
    f"{BENCHMARK_TEST}[modules_used_once": f"{BENCHMARK_TEST}[sweeping",
    f"{BENCHMARK_TEST}[own_data": "tests/tables/test_shapes.py::test_",
    f"{BENCHMARK_TEST}[linkage_paths": (
        "tests/design/test_linkage_path.py::test_published_problems_are_solved_at_least_as_well"
    ),
    f"{BENCHMARK_TEST}[leaderboard": f"{BENCHMARK_TEST}[engines",
    f"{BENCHMARK_TEST}[loops": "tests/evidence/test_loops.py::test_",
    f"{BENCHMARK_TEST}[tolerance_band": "tests/design/test_tolerances.py::test_",
    f"{BENCHMARK_TEST}[contacts": f"{BENCHMARK_TEST}[sweeping",
    f"{BENCHMARK_TEST}[balancer]": f"{BENCHMARK_TEST}[sweeping",
    f"{BENCHMARK_TEST}[files_passed": f"{BENCHMARK_TEST}[sweeping",
    f"{BENCHMARK_TEST}[foreign": f"{BENCHMARK_TEST}[sweeping",
    f"{LENGTH_TEST}[ball_bounces-height-pymunk": f"{LENGTH_TEST}[balls_in_row-gap-pymunk",
    f"{LENGTH_TEST}[balancer_sine_free_preload-pendulum-mujoco": (
        f"{LENGTH_TEST}[balancer4_sam_prescribed-pendulum-mujoco"
    ),
    "tests/verdict/test_detectable.py::test_statements_on_parameters_hold_for_changed_parameters"
    "[balancer_progressive_locked": (
        "tests/verdict/test_detectable.py::test_statements_on_parameters_hold_for_changed_parameters"
        "[rod_cantilever"
    ),
    f"{RODS}/rod_taut.toml::mujoco": (
        "tests/sim/test_rods_taut.py::test_taut_rods_sag_equally_in_both_engines"
    ),
    # the pytest item of a sidecar validates its case first
    f"{VALID_CASES_TEST}[pfr3": f"{RODS}/pfr3.toml::mujoco",
    f"{VALID_CASES_TEST}[rfr3": f"{RODS}/rfr3.toml::mujoco",
    f"{RODS}/rod_follower.toml::pymunk": (
        "tests/sim/test_rods_loads.py::test_a_chain_under_all_loads_equals_the_links_equilibrium"
    ),
    "tests/test_twin_engine.py::test_pytest_runs_the_twin": (
        "tests/test_twin_engine.py::test_check_agrees_with_the_twin_and_not_with_the_wrong_one"
    ),
    "tests/analytic/rods/test_rod_maps.py::test_the_aspect_of_a_stable_equilibrium_is_stable": (
        "tests/analytic/rods/test_rod_maps.py::test_triangles_of_both_signs_meet_at_the_singularity"
    ),
    "tests/analytic/rods/test_rod_solutions.py::test_random_starts_find_no_other": (
        "tests/analytic/rods/test_rod_solutions_bound.py::test_galerkins_method_finds_the_equilibria_under_large_loads"
    ),
}
DEFAULT_PARAMETERS = {
    "tests/sim/hosts/test_host_contacts.py": {
        "test_impacts_are_those_of_the_reference": [
            "ball_bounces-dart",
            "block_rocks-rapier",
            "balls_in_row-box2d",
        ],
        "test_another_restitution_shows": ["bullet", "dart"],
        "test_another_size_of_a_shape_shows": ["here", "rapier"],
        "test_another_friction_shows": ["box2d", "here"],
        "test_an_error_of_impacts_falls_with_the_step": ["dart"],
        "test_what_slides_in_drake_has_the_normal_force_of_the_step_before": ["block_slides"],
    },
    "tests/sim/hosts/test_impulse_engines.py": {
        "test_joints_of_a_loop_stick_together": ["box2d"],
        "test_all_forces_act": ["bullet", "dart"],
        "test_a_joint_sticks_and_slips_in_a_sweep": ["dart"],
        "test_an_armature_between_links_is_refused_by_its_name": ["box2d"],
        "test_dry_friction_brings_a_pendulum_to_rest": ["pymunk==6.8.1"],
        "test_a_run_is_the_same_after_another_one": ["dart"],
        "test_a_platform_in_space_on_universal_joints": ["dart"],
        "test_versions_of_pymunk_have_the_same_digits": ["gear_pair"],
    },
    "tests/sim/hosts/test_exact_engines.py": {
        "test_accuracy_of_simbody_is_its_error": ["fourbar_released"],
        "test_pinocchio_closes_driven_loops_to_rounding": ["hacksaw_sampled"],
        "test_steps_of_pinocchio_are_of_fourth_order": ["heavy_top"],
    },
    "tests/sim/hosts/test_newton.py": {
        "test_driven_loops_follow_the_reference": ["threeprr"],
    },
    "tests/sim/hosts/test_rests.py": {
        "test_rest_of_a_rod_is_that_of_its_chain": ["rod_cantilever"],
        "test_what_falls_ends_on_its_stop": ["here", "dart"],
    },
    "tests/reference/test_path.py": {
        "test_rates_and_accelerations_are_derivatives": ["rfr2_line"],
    },
    "tests/base/test_worker.py": {
        "test_the_limit_is_that_of_one_call_not_of_all_calls_of_a_worker": ["0.1"],
    },
    "tests/verdict/test_nothing_moved.py": {
        "test_a_model_at_rest_is_never_green": ["hangs-alone", "balanced beam-planar", "motor"],
        "test_no_sidecar_is_proposed_that_is_green_on_a_model_at_rest": ["a balanced beam"],
        "test_a_sweep_in_which_nothing_but_the_drive_moves_is_not_green": ["80"],
        "test_two_samples_at_the_ends_of_a_swing_are_not_green": ["fourbar"],
        "test_a_run_with_another_step_than_the_models_is_not_green": ["0.02-361", "0.05-70"],
        "test_a_proposed_case_runs_the_step_of_the_model": ["0.025"],
    },
    "tests/test_strangers.py": {
        "test_a_stream_of_any_encoding_is_printed_to": ["ascii", "shift-jis"],
    },
    "tests/analytic/test_dry_friction.py": {
        "test_random_chains_have_the_events_of_an_ode_with_all_patterns_tried": [
            "14-",
            "108-rebound",
            "101-rest-planar",
        ],
        "test_both_references_meet_stops_of_all_joints_at_the_same_times": ["209"],
        "test_energy_falls_by_the_work_of_friction": ["34-planar", "33-spatial"],
        "test_four_pins_of_a_five_bar_break_loose_when_a_ray_of_its_motions_says": ["planar"],
        "test_linkages_halt_when_an_equation_in_one_coordinate_says": [
            "four-bar 2.5-planar",
            "slider-crank 0.3-spatial",
        ],
    },
    "tests/sim/test_features.py": {
        "test_a_feature_acts_as_in_bare_mujoco_or_is_said_or_has_no_effect": [
            "force of an actuator on a driven joint",
            "armature of a tendon",
            "cutoff of a sensor",
        ],
    },
    "tests/report/test_browser.py": {
        "test_every_channel_of_every_run_can_be_shown": ["rod_cantilever"],
    },
    "tests/report/test_pictures.py": {
        "test_a_changed_first_screen_does_not_match_its_stored_picture": ["a missing panel"],
    },
    "tests/report/test_views.py": {
        "test_springs_are_drawn_as_spirals": ["3"],
    },
    "tests/report/test_chart_figure.py": {
        "test_panels_form_a_grid_with_axis_labels_at_its_edges": ["1-grid0", "4-grid3", "5-grid4"],
    },
    "tests/report/test_index_browser.py": {
        "test_columns_of_a_third_engine_fit_on_the_screen": ["390", "1280"],
    },
    "tests/analytic/planar/test_andrews.py": {
        "test_an_error_in_the_fifth_digit_changes_the_motion": ["4530.01"],
    },
    "tests/analytic/spatial/test_flyball_governor.py": {
        "test_the_reference_moves_as_the_equations": ["0.2"],
        "test_other_numbers_do_not_lead_to_the_printed_curve": ["changes2-0.7"],
        "test_a_small_error_in_the_model_changes_the_motion": ["8e5"],
    },
    "tests/analytic/planar/test_planar_rests.py": {
        "test_a_snap_ends_a_path_for_any_samples": ["572"],
        # 8, 108, 14, 166: with stops, with a snap, ending at a sample, with a slack spring
        "test_random_chains_have_the_equilibria_of_mujoco": ["8]", "14]", "166"],
    },
    "tests/analytic/planar/test_planar_springs.py": {
        "test_polynomial_springs_and_dampers_agree_with_the_spatial_reference": ["True"],
    },
    "tests/analytic/rods/test_rod_solutions_bound.py": {
        "test_a_bound_up_to_a_limit_agrees_with_the_whole_bound": ["rfr2", "pfr3"],
    },
    "tests/analytic/test_stops.py": {
        # both solvers use one integrator of motions with stops: each ratio with one of them
        "test_a_mass_bounces_on_a_stop_as_a_ball_on_the_ground": [
            "1e-09-planar",
            "0.2-planar",
            "1.0-spatial",
            "5.0-spatial",
        ],
    },
    "tests/analytic/spatial/test_spatial_loops.py": {
        # rows are zero to the bit about z, and up to rounding about the last axis
        "test_a_loop_that_no_joint_can_open_does_not_act": [
            "second hinge-axis0",
            "second hinge-axis2",
            "plate-axis2",
        ],
    },
    "tests/analytic/spatial/test_spatial_rests.py": {
        "test_equilibria_are_those_of_mujoco": ["True"],  # with stops, at which joints rest or not
        "test_a_driven_planar_motion_is_that_of_the_planar_reference": ["range"],
    },
    "tests/analytic/rods/test_rod_continuation.py": {
        "test_unloading_leads_to_the_recomputed_equilibria": ["S2"],
    },
    "tests/analytic/rods/test_spatial_rod.py": {
        "test_a_helix_under_a_wrench_along_its_axis_is_another_helix": ["0.9-2.9"],
        "test_a_formulation_by_strains_agrees": ["natural0", "natural3"],
        "test_a_rod_under_loads_in_its_plane_is_the_planar_rod": [
            "strains0-force",
            "strains1-weight",
        ],
        "test_twice_the_steps_move_the_tip_by_the_tolerance_only": ["20.0", "5.0-1.2"],
        "test_a_column_of_equal_stiffnesses_buckles_at_eulers_load": ["0.98-True", "1.02-False"],
    },
    "tests/sim/test_rods_in_space.py": {
        "test_a_wrong_number_of_the_rod_differs": ["torsion = 0.0083"],
    },
    "tests/analytic/rods/test_rod_platform.py": {
        "test_shooting_finds_the_same_equilibria": ["load0"],
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
        "test_each_fold_adds_a_negative_direction": ["0.5", "0.8"],
        "test_one_stable_equilibrium_is_left_beyond_the_fold": ["54.338"],
    },
    "tests/analytic/rods/test_rod_solutions.py": {
        "test_every_known_equilibrium_is_found_with_its_energy_and_stability": ["rfr2", "unloaded"],
        "test_equilibria_satisfy_the_shooting_equations": ["rfr2", "rfr3"],
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
        "test_engines_agree_and_a_wrong_extension_differs": ["change0", "change3"],
    },
    "tests/analytic/balancer/test_balancer.py": {
        "test_curves_are_those_recomputed_independently": ["17", "20"],
    },
    "tests/analytic/balancer/test_balancer_grid.py": {
        "test_printed_results_of_four_segments_are_met": ["17", "20"],
    },
    "tests/analytic/balancer/test_balancer_lines.py": {
        "test_general_fitter_finds_nothing_better": ["sine-", "laevo-"],
    },
    "tests/analytic/balancer/test_balancer_posture.py": {
        "test_a_changed_model_differs_in_both_engines": ["stiffness", "pos="],
    },
    "tests/analytic/balancer/test_spring_release.py": {
        "test_a_wrong_spring_or_contact_differs": [
            "series-range",
            "series-stiffness",
            'parallel-springref="0.0405"',
        ],
    },
    "tests/analytic/planar/test_planar_free.py": {
        "test_parallelograms_pass_their_flat_poses_on_the_motion_of_a_pendulum": ["11", "321"],
    },
    "tests/analytic/linkages/test_threeprr_maps.py": {
        "test_aspects_have_the_sign_of_the_inverse_problem": ["--0.4-"],
        "test_singularity_measure_changes_sign_across_type_2_curves": ["--0.4-"],
    },
    "tests/design/test_design_search.py": {
        "test_an_interrupted_search_has_the_result_of_an_uninterrupted_one": ["2"],
    },
    "tests/design/test_design_synthesis.py": {
        "test_a_batch_has_the_values_of_its_single_designs": [
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
        "test_a_wrong_stiffness_gives_another_limit": ["0.8"],
    },
    "tests/studies/stress/test_stress_singular.py": {
        "test_the_shortest_arm_spans_the_largest_distance_of_its_ends": ["fourbar"],
    },
    "tests/studies/stress/test_stress.py": {
        "test_scaled_mechanisms_have_scaled_curves": [
            "sweep",
            "slider_crank-dynamics-3e-06-mujoco",
            "fourbar_released-dynamics-3e-06-pymunk",
        ],
    },
    "tests/studies/stress/test_stress_bare.py": {
        "test_bare_engines_have_the_limits_of_theory_in_small_models": ["spring", "hung"],
        "test_time_step_limits_of_mujoco_are_confirmed_without_proofmass": ["RK4"],
    },
    "tests/studies/trade/test_program.py": {
        "test_a_program_gives_the_curves_of_the_engine": ["fourbar", "pendulum"],
        "test_the_program_of_a_fourbar_agrees_with_its_geometry": ["drive0", "drive1"],
    },
    "tests/studies/trade/test_program_rods.py": {
        "test_default_classes_do_not_affect_the_links_of_a_program": ["defaults2"],
        "test_servos_and_equalities_move_rods": ["drive1"],
    },
    "tests/studies/trade/test_pymunk_program.py": {
        "test_a_program_gives_the_curves_of_simulate": [
            "fourbar",
            "hacksaw",
            "threeprr",
            "pendulum",
            "arm_servos",
        ],
    },
    "tests/evidence/test_diagnosis.py": {
        "test_the_planted_fault_is_the_first_cause": [
            "parameter",
            "fourbar-factor-holding_moment",
            "offset",
            "slider_crank-shift",
            "quantity",
        ],
    },
    "tests/verdict/test_compare.py": {
        "test_a_wrong_gear_ratio_is_found_by_a_constant_rate": ["-0.001"],
    },
    "tests/sim/test_limits.py": {
        "test_a_sweep_across_a_limit_position_stops_there": ["mujoco-fourbar", "pymunk-planar"],
    },
    "tests/sim/test_changing_loads.py": {
        "test_rates_under_a_growing_load_are_derivatives_of_the_path": ["case0"],
        "test_a_four_bar_under_a_growing_load_agrees": ["to = 6.28"],
    },
    "tests/sim/test_rods_loads.py": {
        "test_a_wrong_load_of_a_rod_differs": ["load = [4.1", "load = .*", "gear=", "refsite"],
    },
    "tests/sim/test_recorded.py": {
        "test_missing_rows_are_refused": ["rows0", "rows1", "rows3"],
    },
    "tests/sim/test_rods_taut.py": {
        "test_a_wrong_taut_rod_differs": ["axial"],
    },
    "tests/sim/test_rods_strained.py": {
        "test_a_wrong_axial_or_shear_stiffness_differs": ["42.0", "19.0"],
    },
    "tests/sim/test_rods_driven.py": {
        "test_a_wrong_rod_differs_in_both_engines": ["1.02", "naive"],
    },
    "tests/sim/test_disable_flags.py": {
        "test_disabled_features_are_as_if_absent": [
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
        "test_a_change_acts_on_its_number_only": [
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
        "test_the_engine_settles_in_the_equilibria_of_the_sweep": ["contact", "four"],
    },
    "tests/sim/mujoco/test_written_settings.py": {
        "test_a_program_with_contacts_equals_the_engines_run": ["settings1", "settings2"],
        "test_a_program_with_a_loop_equals_the_engines_run": ["changed0"],
    },
    "tests/sim/pymunk/test_pymunk_statics.py": {
        "test_balancers_have_the_moments_of_their_equilibria": ["nonlinear", "contact", "four"],
        "test_the_moment_is_that_of_spring_1_and_the_derivative_of_the_energy": [
            "released",
            "four",
        ],
        "test_a_sweep_has_the_same_curves_upwards_and_downwards": ["four"],
    },
    "tests/sim/test_rods_platform.py": {
        "test_platforms_converge_to_those_of_rods": ["S1"],
        "test_poses_of_a_driven_platform_are_chain_equilibria": ["pymunk"],
    },
    "tests/sim/pymunk/test_pymunk_stops.py": {
        "test_a_large_preload_keeps_a_joint_on_its_stop": ["four"],
    },
    "tests/sim/test_friction.py": {
        "test_every_friction_that_is_0_1_percent_larger_differs": [
            "mujoco",
            "shaft_pendulum-0-pymunk",
            "slider_crank_friction-1-pymunk",
        ],
    },
    "tests/verdict/test_mutations.py": {
        "test_a_wrong_inertia_changes_the_moment_of_a_drive": ["mujoco", "fourbar-1.30"],
        "test_a_wrong_mass_changes_the_channels_that_depend_on_it_alone": [
            "mujoco",
            '"1.5 0 0" mass',
        ],
        "test_a_wrong_number_changes_the_motion_of_the_parallelograms": ["mujoco", "qpos"],
        "test_a_wrong_load_on_the_slider_changes_the_holding_moment_alone": [
            'slider_crank_offset-ctrl="0 -50"-ctrl="0 -50.001"-mujoco',
            'hacksaw_cutting-ctrl="0 10"-ctrl="0 10.001"-pymunk',
        ],
    },
}
"""Words in the parameters that run by default, by file and test; each test makes one claim."""
