//! Which test stands for which item of VALIDATION section 5; printed, and checked against the sources.

use std::path::{Path, PathBuf};

/// Number, item, and the tests for it as `file::name`; files from the root of the package, without `.rs`.
type Row = (u8, &'static str, &'static [&'static str]);

/// The tests that run over the whole case library.
const TABLE_OF_CASES: &[&str] = &[
    "tests/physics/hard_cases::every_estimator_is_finite_and_bounded_on_every_case",
    "tests/physics/hard_cases::every_surface_is_closed_up_to_the_box_and_has_unit_normals",
    "tests/physics/hard_cases::every_case_is_lit_within_bounds_and_exported",
    "tests/physics/hard_rays::no_ray_leaks_or_hits_its_start_and_twins_with_an_epsilon_do",
];

const ROWS: &[Row] = &[
    (27, "every item: estimators, extraction, relight, export, rays", TABLE_OF_CASES),
    (
        27,
        "constant volume",
        &[
            "src/level/tests/shapes::a_constant_volume_hits_nothing",
            "tests/program/hard_cli::what_has_no_surface_is_an_error_or_with_allow_empty_an_empty_valid_file",
        ],
    ),
    (
        27,
        "plateau at the isovalue, zero-gradient texels",
        &[
            "src/level/tests/sites::flat_neighbourhoods_have_no_site",
            "src/relight/tests::every_fallback_of_the_lookup_does_what_it_says_and_is_counted",
        ],
    ),
    (
        27,
        "NaN and Inf voxels",
        &[
            "tests/physics/hard_cases::what_is_no_volume_is_refused_by_name",
            "tests/physics/hard_cases::readers_say_what_they_replaced",
            "src/volume/assemble/tests::non_finite_samples_go_to_the_lit_side",
        ],
    ),
    (
        27,
        "isovalue equal to voxel values, to the minimum, to the maximum",
        &[
            "src/level/tests/shapes::isovalues_equal_to_samples_to_the_minimum_and_to_the_maximum",
            "src/surface/tests::whole_numbers_full_of_ties_stay_closed_and_without_degenerate_triangles",
        ],
    ),
    (
        27,
        "2×2×2 and 1×N×M grids",
        &[
            "tests/physics/hard_cases::volumes_without_cells_are_refused_by_the_estimators_and_have_no_surface",
            "tests/program/hard_cli::grids_of_one_cell_are_lit_and_grids_without_cells_refused",
            "src/level/tests/shapes::grids_of_a_cell_or_a_slab_of_cells",
            "src/surface/tests::small_and_flat_grids",
        ],
    ),
    (27, "single-voxel spike", &["src/level/tests/sites::spikes_and_pits_on_a_slope_move_into_the_inner_range"]),
    (
        27,
        "3D checkerboard, all ambiguous cells",
        &[
            "src/surface/tests::every_pattern_has_the_topology_of_the_refined_cell",
            "src/surface/tests::alternating_cells_have_the_topology_of_the_refined_cell",
            "src/surface/watertight::the_mesh_of_a_random_ambiguous_cell_is_the_trilinear_level_set",
            "src/surface/watertight::every_pattern_is_closed_at_every_scale_in_every_frame",
        ],
    ),
    (
        27,
        "shells thinner than a voxel",
        &[
            "src/level/tests/traversal::the_pyramid_changes_no_bit_and_f64_agrees",
            "src/surface/watertight::vertices_lie_on_the_level_set_and_faces_within_their_curvature",
        ],
    ),
    (
        27,
        "spacing 1:1:100, oblique and left-handed affines, origins of 1e6",
        &[
            "src/level/tests/shapes::rays_agree_with_the_definition_under_any_affine",
            "src/level/tests/normals::world_normals_are_covectors_under_any_affine",
            "src/surface/tests::fronts_and_normals_look_to_the_lit_side_in_every_frame",
        ],
    ),
    (
        27,
        "ranges of 1e-30, 1e+30, subnormal",
        &[
            "src/level/tests/shapes::scaling_by_powers_of_two_changes_no_bit_and_flipping_the_side_neither",
            "src/level/tests/cubics::subnormal_and_huge_coefficients_keep_their_roots",
            "src/volume/assemble/tests::extreme_ranges_are_rescaled_by_an_exact_power_of_two",
        ],
    ),
    (
        27,
        "u8, i16, u16, f32, f64, big-endian",
        &[
            "tests/physics/hard_cases::every_sample_type_gives_the_same_surface",
            "src/volume/tests/nifti::every_type_in_both_byte_orders",
            "src/volume/tests/nrrd::encodings_types_and_byte_orders",
        ],
    ),
    (
        28,
        "axis-aligned, grazing, through edges and corners, from the surface",
        &[
            "tests/physics/hard_rays::no_ray_leaks_or_hits_its_start_and_twins_with_an_epsilon_do",
            "src/level/tests/march::skipping_blocks_changes_no_bit_of_any_outcome",
            "src/level/tests/traversal::the_pyramid_changes_no_bit_and_f64_agrees",
            "src/level/tests/rays::rays_agree_with_the_definition",
            "src/surface/watertight::rays_meet_the_surface_where_the_mesh_is",
        ],
    ),
    (
        28,
        "vanishing leading terms, double and triple roots, roots at faces",
        &[
            "src/level/tests/cubics::planted_roots",
            "tests/physics/hard_rays/planted::planted_planes_are_hit_at_every_multiplicity_and_scale",
            "tests/physics/hard_rays/planted::double_and_triple_roots_in_one_point",
        ],
    ),
    (
        29,
        "one texel of 1e6, 1×1",
        &[
            "tests/physics/hard_environments::one_texel_of_1e6",
            "tests/physics/hard_environments::a_single_pixel",
            "tests/physics/hard_cases/options::\
             a_probe_of_one_pixel_is_a_constant_and_one_texel_of_a_million_keeps_its_energy",
            "src/probe/tests::black_and_single_pixel_probes_are_harmless",
            "src/probe/read/tests::single_pixels_and_odd_sizes",
        ],
    ),
    (
        29,
        "sun on ±y, all zero, constant, two opposite suns",
        &[
            "tests/physics/hard_environments::a_sun_exactly_on_the_poles",
            "tests/physics/hard_environments::all_zero",
            "tests/physics/hard_environments::constant",
            "tests/physics/hard_environments::two_opposite_suns",
            "src/probe/tests::opposite_suns_have_no_first_band",
            "src/probe/tests::a_constant_is_exact_at_any_resolution",
            "tests/physics/light::certified_light_on_a_positive_bake_of_four_rays_is_non_negative",
            "tests/physics/sh_properties::black_and_constant_functions_pass_through_the_certificate",
        ],
    ),
    (
        29,
        "negative and NaN texels, odd sizes, 21 EV",
        &[
            "tests/physics/hard_environments::negative_and_nan_texels",
            "tests/physics/hard_environments::odd_sizes",
            "tests/physics/hard_environments::a_range_of_21_stops",
            "tests/physics/hard_environments::any_pixels_become_a_finite_probe",
            "src/probe/read/tests::impossible_pixels_are_counted",
            "src/probe/read/tests::exr_compressions_and_sample_types",
            "tests/program/cli::a_probe_with_nan_works_with_a_note_and_fails_its_check",
        ],
    ),
    (
        29,
        "bands 1 and 11",
        &[
            "tests/physics/hard_environments::bands_1_and_11",
            "tests/physics/hard_cases/options::one_band_and_eleven_bands_are_lit_within_the_light",
            "tests/physics/sh_properties::rotations_compose_invert_keep_norms_and_move_values",
            "tests/physics/sh_properties::bounds_hold_at_every_direction_and_do_not_depend_on_the_frame",
            "tests/physics/sh_properties::certified_functions_are_nowhere_negative_at_any_scale_and_keep_their_mean",
        ],
    ),
    (
        29,
        "albedo 0, 0.99, 1",
        &[
            "tests/physics/hard_environments::albedos_0_and_nearly_1_and_1",
            "tests/physics/hard_cases/options::albedo_1_in_a_closed_room_stops_and_says_what_it_left_out",
            "tests/physics/hard_cases/options::albedo_1_of_what_is_open_leaves_nothing_out_of_reflection",
            "tests/program/hard_cli::albedo_1_with_emission_says_what_it_left_out",
        ],
    ),
    (
        30,
        "truncated at every kind of place, damaged",
        &[
            "tests/program/hard_files::truncated_volumes_probes_and_stores",
            "tests/fuzz/main::a_fixed_number_of_damaged_inputs_for_each_target",
            "src/volume/tests/hostile::every_truncation_of_every_format_is_an_error_with_a_reason",
            "src/volume/tests/hostile::every_single_byte_of_damage_is_survived",
            "src/transfer/store/tests/damage::damage_is_found_by_name_or_has_no_effect",
            "src/probe/read/tests::damaged_files_are_refused_without_panic",
        ],
    ),
    (
        30,
        "a header that claims 1e12 voxels, sizes beyond any memory",
        &[
            "tests/program/hard_files::a_header_that_claims_1e12_voxels",
            "src/volume/tests/hostile::headers_that_claim_a_trillion_voxels_fail_at_once",
            "src/transfer/store/tests/damage::a_header_that_claims_too_much_is_refused_before_memory_is_asked_for",
            "tests/physics/hard_cases/options::textures_beyond_any_memory_are_refused_before_any_is_taken",
            "tests/program/hard_cli::more_memory_than_allowed_is_refused_with_the_figure_and_what_to_change",
        ],
    ),
    (
        30,
        "wrong magic, wrong version, zero-length, a directory",
        &[
            "tests/program/hard_files::wrong_magic",
            "tests/program/hard_files::wrong_version",
            "tests/program/hard_files::zero_length",
            "tests/program/hard_files::a_directory_in_place_of_a_file",
            "src/volume/tests/hostile::wrong_files_are_named",
            "src/transfer/store/tests/paths::paths_that_hold_no_store_are_named",
            "tests/program/cli::bad_input_is_refused_by_name_and_leaves_nothing",
        ],
    ),
    (
        30,
        "gzip bombs",
        &[
            "tests/program/hard_files::a_gzip_bomb",
            "src/volume/tests/hostile::of_a_gzip_bomb_only_what_the_header_asks_for_is_unpacked",
        ],
    ),
    (
        30,
        "no permission, disk full",
        &[
            "tests/program/hard_files::no_permission_to_read",
            "tests/program/hard_files::no_permission_to_write",
            "tests/program/hard_files::disk_full_while_a_store_is_made",
            "tests/program/hard_files::disk_full_while_a_store_grows",
            "tests/program/hard_files::disk_full_while_results_are_written",
            "tests/program/cli::an_output_that_cannot_be_written_is_refused_before_the_work",
            "src/export/tests::a_stream_that_fails_anywhere_is_an_error",
        ],
    ),
    (
        30,
        "killed in mid-bake, two processes on one output",
        &[
            "tests/program/hard_files::kill_9_in_mid_bake",
            "tests/program/hard_files::two_processes_on_one_output",
            "tests/program/resume::twenty_kills_leave_the_bytes_of_an_unbroken_bake",
            "tests/program/resume::a_second_bake_of_a_store_is_told",
            "src/transfer/store/tests/damage::a_killed_writer_leaves_a_chunk_that_is_baked_again",
            "src/transfer/store/tests/damage::a_reader_beside_a_writer_never_sees_two_writings_mixed",
            "src/transfer/store/tests/paths::a_second_baker_is_kept_out_until_the_first_is_done",
        ],
    ),
    (
        31,
        "linear COLOR_0, values above 1, empty, > 65,535 vertices, unit normals, the validator",
        &[
            "tests/readers/gltf_validator::files_read_back_the_same_and_pass_the_khronos_validator",
            "src/export/tests::unsound_meshes_are_refused_by_name",
            "src/export/tests::empty_ply_has_no_elements",
            "tests/physics/hard_cases::every_case_is_lit_within_bounds_and_exported",
        ],
    ),
];

/// Whether a source file has a test of this name.
fn exists(root: &Path, test: &str) -> bool {
    let Some((file, name)) = test.rsplit_once("::") else { return false };
    let text = [format!("{file}.rs"), format!("{file}/mod.rs")]
        .iter()
        .find_map(|path| std::fs::read_to_string(root.join(path)).ok())
        .unwrap_or_default();
    // A test has `#[test]` among the attributes before it.
    text.match_indices(&format!("fn {name}(")).any(|(at, _)| {
        let before = text[..at].trim_end();
        before.lines().rev().take(3).any(|line| line.trim() == "#[test]")
    })
}

#[test]
fn map() {
    // Read at run time, so that the compiled test can be pointed at another checkout.
    let root = std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    let mut missing = Vec::new();
    for (number, item, tests) in ROWS {
        println!("{number}  {item}");
        for test in *tests {
            println!("      {test}");
            if !exists(&root, test) {
                missing.push(*test);
            }
        }
    }
    assert!(missing.is_empty(), "no such test: {missing:#?}");
    for number in 27..=31 {
        assert!(ROWS.iter().any(|row| row.0 == number), "nothing stands for number {number}");
    }
    assert!(!exists(&root, "tests/physics/hard_cases::each_solved"), "what is no test must not pass for one");
}
