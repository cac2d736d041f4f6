//! The permitted error of every public function, and what it is measured against.
//!
//! Errors are relative. Four sources of inputs feed every measured row: a list (with the reference files), the edges of
//! the domain, an even spacing, and chance.

use crate::measure::{self, Record};

/// One public function.
pub struct Row {
    /// `room::file::Type::function`, or `room::file::function`.
    pub function: &'static str,
    /// How its numbers are checked.
    pub check: Check,
}

/// What is known of a function's error.
pub enum Check {
    /// It stays below a bound.
    Within {
        /// The greatest relative error that is permitted.
        permitted: f64,
        /// What it is measured against.
        against: &'static str,
        /// The measurement.
        measure: fn() -> Record,
    },
    /// It has no accuracy of its own: it constructs, selects or copies. The named test covers it.
    Total {
        /// A test function of this folder.
        test: &'static str,
    },
}

const fn within(function: &'static str, permitted: f64, against: &'static str, measure: fn() -> Record) -> Row {
    Row { function, check: Check::Within { permitted, against, measure } }
}

const fn total(function: &'static str, test: &'static str) -> Row {
    Row { function, check: Check::Total { test } }
}

const FILES: &str = "reference files and double-double quadrature";
const DEFINITION: &str = "the definition in double-double arithmetic";
const QUADRATURE: &str = "double-double quadrature";

/// All rows.
pub const TABLE: &[Row] = &[
    // the profile
    within("profile::Profile::f", 1e-13, DEFINITION, measure::profile::f),
    within("profile::Profile::f_past", 1e-13, DEFINITION, measure::profile::f_past),
    within("profile::Profile::f_fast", 1e-11, DEFINITION, measure::profile::f_fast),
    within("profile::Profile::normalization", 1e-13, FILES, measure::profile::normalization),
    within("profile::Profile::cdf", 1e-12, FILES, measure::profile::cdf),
    within("profile::Profile::sf", 1e-12, FILES, measure::profile::sf),
    within("profile::Profile::quantile", 1e-11, "cdf and back, both ways", measure::profile::quantile),
    within("profile::Profile::isf", 1e-11, "sf and back, both ways", measure::profile::isf),
    within("profile::Profile::mean", 1e-13, QUADRATURE, measure::profile::mean),
    // its parts
    within("family::partial_moment::Radius::of", 1e-30, DEFINITION, measure::moments::radius),
    within("family::partial_moment::Side::kernel", 1e-13, DEFINITION, measure::moments::kernel),
    within("family::partial_moment::Side::kernel_fast", 1e-11, DEFINITION, measure::moments::kernel_fast),
    within("family::partial_moment::Side::depth", 1e-14, DEFINITION, measure::moments::depth),
    within("family::partial_moment::Side::radius_at_depth", 1e-13, DEFINITION, measure::moments::radius_at_depth),
    within("family::partial_moment::Side::total", 1e-14, QUADRATURE, measure::moments::total),
    within("family::partial_moment::Side::lower", 1e-12, QUADRATURE, measure::moments::lower),
    within("family::partial_moment::Side::upper", 1e-12, QUADRATURE, measure::moments::upper),
    within("numerics::gamma_ratio::gamma", 3e-15, QUADRATURE, measure::moments::gamma),
    within("numerics::gamma_ratio::scaled_gamma_ratio", 2e-14, QUADRATURE, measure::moments::scaled_gamma_ratio),
    within("numerics::exponent::Exponent::of", 4e-16, DEFINITION, measure::moments::power),
    within("numerics::exponent::Exponent::fast", 2e-13, DEFINITION, measure::moments::power_fast),
    within("numerics::exponent::Exponent::fast_reciprocal", 2e-13, DEFINITION, measure::moments::reciprocal_fast),
    // masking
    within("masking::integral::MaskingIntegral::at", 1e-12, FILES, measure::masking::lambda),
    within("masking::integral::MaskingIntegral::by_quadrature", 1e-12, FILES, measure::masking::lambda_by_quadrature),
    // S is the slope of tables only
    within("masking::integral::MaskingIntegral::at", 1e-11, QUADRATURE, measure::masking::share),
    // directions
    within("ndf::Ndf::d", 1e-13, DEFINITION, measure::directions::d),
    within("ndf::Ndf::lambda", 1e-12, QUADRATURE, measure::directions::lambda),
    within("ndf::Ndf::projected_area", 1e-12, QUADRATURE, measure::directions::projected_area),
    within("ndf::Ndf::g1", 1e-12, QUADRATURE, measure::directions::g1),
    within("ndf::Ndf::g2", 1e-12, QUADRATURE, measure::directions::g2),
    within("ndf::Ndf::pdf_projected", 1e-13, DEFINITION, measure::directions::pdf_projected),
    // solvers
    within("numerics::quadrature::Gauss::integrate", 3e-14, "powers of x", measure::solvers::gauss_rule),
    within("numerics::invert::solve", 4e-15, "inverses in closed form", measure::solvers::inversion),
    within("sampling::azimuth::Azimuth::mass", 1e-14, QUADRATURE, measure::solvers::azimuth_mass),
    // one step of the iteration; what is left moves the drawn azimuth, not the density that is reported for it
    within("sampling::azimuth::Azimuth::sample", 3e-8, QUADRATURE, measure::solvers::azimuth_sample),
    // constructed, selected or copied
    total("scattering::albedo::Incidence::new", "views_know_their_roughness"),
    total("scattering::albedo::SingleScattering::new", "missing_energy_agrees_with_brute_force"),
    total("scattering::albedo::SingleScattering::missing_energy", "missing_energy_agrees_with_brute_force"),
    total("scattering::albedo_table::coordinates::Coordinates::new", "coordinates_span_the_table"),
    total("scattering::albedo_table::coordinates::Coordinates::view", "coordinates_span_the_table"),
    total("scattering::albedo_table::coordinates::Coordinates::roughness", "coordinates_span_the_table"),
    total("scattering::albedo_table::coordinates::Coordinates::log_roughness", "coordinates_span_the_table"),
    total("scattering::albedo_table::coordinates::Coordinates::greatest", "coordinates_span_the_table"),
    total("scattering::albedo_table::coordinates::Coordinates::azimuth", "coordinates_span_the_table"),
    total("scattering::albedo_table::isotropic::AlbedoTable::isotropic", "tables_hold_what_is_missing"),
    total("scattering::albedo_table::pair::AlbedoTable::anisotropic", "anisotropic_tables_hold_what_is_missing"),
    total("scattering::albedo_table::AlbedoTable::flat", "tables_hold_what_is_missing"),
    total("scattering::albedo_table::AlbedoTable::grid", "tables_hold_what_is_missing"),
    total("scattering::albedo_table::AlbedoTable::coordinates", "coordinates_span_the_table"),
    total("scattering::albedo_table::AlbedoTable::average", "averages_belong_to_their_tables"),
    total("scattering::albedo_table::AlbedoTable::reached", "tables_hold_what_is_missing"),
    total("scattering::albedo_table::AlbedoTable::missing_energy", "tables_hold_what_is_missing"),
    total("scattering::albedo_table::AlbedoTable::average_missing_energy", "averages_belong_to_their_tables"),
    total("scattering::random_walk::RandomWalk::new", "walks_leave_and_single_ones_are_correlated_scattering"),
    total("scattering::random_walk::RandomWalk::walk", "walks_leave_and_single_ones_are_correlated_scattering"),
    total("scattering::random_walk::RandomWalk::visible_normal", "facets_are_seen_from_both_sides"),
    total("sampling::azimuth::Azimuth::new", "solvers_stay_within_their_permitted_error"),
    total("numerics::greatest", "tables_of_nan_do_not_claim_to_be_exact"),
    total("numerics::exponent::Exponent::new", "powers_near_whole_exponents_are_continuous"),
    total("masking::table::LambdaTable::new", "promised_accuracy_is_reached"),
    total("masking::table::LambdaTable::h", "promised_accuracy_is_reached"),
    total("masking::table::LambdaTable::reached", "promised_accuracy_is_reached"),
    total("masking::table::LambdaTable::flat", "flat_masking_table_gives_what_the_core_gives"),
    total("masking::integral::MaskingIntegral::new", "masking_stays_within_its_permitted_error"),
    total("ndf::Roughness::new", "roughness_out_of_range_is_named"),
    total("ndf::Ndf::new", "accuracy_out_of_range_is_named"),
    total("ndf::Ndf::projected", "the_table_of_projected_normals_is_the_last_row"),
    total("ndf::Ndf::profile", "projected_normals_integrate_to_one"),
    total("ndf::Ndf::lambda_table", "flat_masking_table_gives_what_the_core_gives"),
    total("ndf::Ndf::visible_table", "flat_visible_table_gives_what_the_core_gives"),
    total("ndf::Ndf::accuracy_reached", "promised_accuracy_is_reached"),
    total("ndf::Ndf::steepness", "steepness_of_known_profiles"),
    total("ndf::Ndf::pdf_visible", "visible_pdf_integrates_to_what_is_not_lost"),
    total("ndf::Ndf::sample_visible", "visible_normals_are_drawn_from_their_pdf"),
    total("ndf::Ndf::sample_projected", "projected_normals_are_drawn_from_their_pdf"),
    total("family::partial_moment::Width::new", "moments_stay_within_their_permitted_error"),
    total("family::partial_moment::Radius::exact", "moments_stay_within_their_permitted_error"),
    total("family::partial_moment::Side::new", "moments_stay_within_their_permitted_error"),
    total("profile::Profile::breaks", "break_points_divide_the_profile_evenly"),
    total("profile::Profile::cusps", "cusps_are_where_the_profile_is_not_smooth"),
    total("profile::Profile::masking", "closed_form_of_masking_is_exact"),
    total("profile::Profile::tail", "tails_are_what_they_say"),
    total("numerics::quadrature::gauss", "solvers_stay_within_their_permitted_error"),
    total("numerics::quadrature::Gauss::nodes", "nodes_are_ascending_and_weights_sum_to_one"),
    total("family::shape::Shape::new", "shapes_out_of_range_are_named"),
    total("family::shape::Shape::gamma", "shapes_keep_their_parameters"),
    total("family::shape::Shape::p", "shapes_keep_their_parameters"),
    total("family::shape::Shape::lambda", "shapes_keep_their_parameters"),
    total("family::shape::Shape::shift", "shapes_keep_their_parameters"),
    total("family::shape::Row::named", "rows_are_found_by_name"),
    total("family::shape::Row::shape", "rows_fix_their_parameters"),
    total("family::shape::Row::freedom", "the_lattice_is_closed"),
    total("family::shape::Row::allows", "the_lattice_is_closed"),
    total("family::shape::Row::includes", "the_lattice_is_closed"),
    total("family::shape::Row::alpha_scale", "hyper_cauchy_is_student_at_another_scale"),
    total("family::skewed_t::SkewedT::new", "profiles_stay_within_their_permitted_error"),
    total("family::skewed_t::SkewedT::shape", "shapes_keep_their_parameters"),
    total("family::student::StudentMasking::new", "closed_form_of_masking_is_exact"),
    total("family::student::StudentMasking::at", "closed_form_of_masking_is_exact"),
    total("family::tree::nodes", "the_lattice_is_closed"),
    total("family::tree::Node::lowest", "every_corner_of_the_lattice_has_its_node"),
    total("family::tree::Node::is_closed_form", "every_corner_of_the_lattice_has_its_node"),
    total("family::tree::Row::parents", "the_lattice_is_closed"),
    total("family::tree::Row::children", "the_lattice_is_closed"),
    total("sampling::visible_table::VisibleTable::new", "weights_of_visible_normals_are_even"),
    total("sampling::visible_table::VisibleTable::projected", "the_table_of_projected_normals_is_the_last_row"),
    total("sampling::visible_table::VisibleTable::rows", "the_table_of_projected_normals_is_the_last_row"),
    total("sampling::visible_table::VisibleTable::flat", "flat_visible_table_gives_what_the_core_gives"),
    total("sampling::visible_table::VisibleTable::knots", "flat_visible_table_gives_what_the_core_gives"),
    total("sampling::visible_table::VisibleTable::scale", "flat_visible_table_gives_what_the_core_gives"),
    total("sampling::visible_table::VisibleTable::slopes", "flat_visible_table_gives_what_the_core_gives"),
    total("sampling::visible_table::VisibleTable::mixture", "flat_visible_table_gives_what_the_core_gives"),
    total("sampling::visible_table::VisibleTable::unseen", "projected_normals_are_drawn_from_their_pdf"),
    total("sampling::visible_table::VisibleTable::sample", "drawn_slopes_have_the_density_that_is_reported"),
    total("sampling::visible_table::VisibleTable::density", "drawn_slopes_have_the_density_that_is_reported"),
    total("batch::Query::eval", "arrays_are_evaluated_row_by_row"),
    total("batch::Query::named", "arrays_that_do_not_fit_are_refused"),
    total("batch::Query::results", "arrays_are_evaluated_row_by_row"),
    total("batch::Query::width", "arrays_are_evaluated_row_by_row"),
    total("batch::first_of_wrong_length", "the_first_wrong_row_is_found"),
    total("batch::first_outside", "the_first_wrong_row_is_found"),
    total("batch::is_parallel", "arrays_are_evaluated_row_by_row"),
    total("ndf::Ndf::pdf", "every_reflection_can_be_drawn"),
    total("ndf::Ndf::sample", "density_is_that_of_what_is_drawn"),
    total("ndf::Ndf::view", "what_is_drawn_reflects_upwards"),
    total("ndf::View::pdf", "density_is_that_of_what_is_drawn"),
    total("ndf::View::sample", "density_is_that_of_what_is_drawn"),
    total("ndf::View::share", "what_is_drawn_reflects_upwards"),
    total("profile::Profile::bends_at_breaks", "visible_sampling_has_little_variance"),
    total("profile::Profile::coordinate", "visible_sampling_has_little_variance"),
    total("profile::Profile::parts", "masking_is_that_of_the_blended_slopes"),
    total("profile::mixture::MixtureProfile::new", "functions_are_those_of_the_parts"),
    total("profile::mixture::MixtureProfile::width", "functions_are_those_of_the_parts"),
    total("profile::resample::resample", "sixty_four_nodes_make_any_row"),
    total("profile::tabulated::Quantity::named", "quantities_and_angles_say_the_same"),
    total("profile::tabulated::TabulatedProfile::from_angles", "quantities_and_angles_say_the_same"),
    total("profile::tabulated::TabulatedProfile::of", "quantities_and_angles_say_the_same"),
    total("profile::tabulated::TabulatedProfile::knee", "sixty_four_nodes_make_any_row"),
    total("profile::tabulated::TabulatedProfile::with_knee", "sixty_four_nodes_make_any_row"),
    total("profile::tabulated::TabulatedProfile::new", "everything_is_what_the_definition_says"),
    total("profile::tabulated::TabulatedProfile::nodes", "everything_is_what_the_definition_says"),
    total("profile::tabulated::TabulatedProfile::tail_power", "everything_is_what_the_definition_says"),
    total("profile::tabulated::TabulatedProfile::width", "quantities_and_angles_say_the_same"),
    total("sampling::azimuth::Azimuth::bounded", "density_is_that_of_what_is_drawn"),
    total("sampling::bounded::Horizon::limits_azimuth", "what_is_drawn_reflects_upwards"),
    total("sampling::bounded::Horizon::new", "every_reflection_can_be_drawn"),
    total("sampling::bounded::Horizon::square", "every_reflection_can_be_drawn"),
    total("sampling::visible_table::VisibleTable::share_below", "density_is_that_of_what_is_drawn"),
    total("scattering::reflection::Reflection::at", "a_reflection_is_what_its_parts_are"),
    total("scattering::reflection::Reflection::new", "a_reflection_is_what_its_parts_are"),
    total("scattering::reflection::Reflection::sample", "a_reflection_is_what_its_parts_are"),
    total("scattering::reflection::Reflection::view", "a_reflection_is_what_its_parts_are"),
    total("microsurface::agreement::Agreement::of", "slopes_have_the_distribution_that_was_asked_for"),
    total("microsurface::agreement::Agreement::of_slopes", "slopes_have_the_distribution_that_was_asked_for"),
    total("microsurface::facet::Material::scatter", "every_walk_ends"),
    total("microsurface::facet::Material::reflectance", "metals_absorb"),
    total("microsurface::facet::conductor", "metals_absorb"),
    total("microsurface::facet::dielectric", "glass_reflects_or_transmits"),
    total("microsurface::generate::generate", "slopes_have_the_distribution_that_was_asked_for"),
    total("microsurface::goniometer::Setup::bins", "every_walk_ends"),
    total("microsurface::goniometer::Setup::measure", "every_walk_ends"),
    total("microsurface::goniometer::Setup::measure_model", "the_model_is_measured_alike"),
    total("microsurface::goniometer::Counts::flat", "the_model_is_measured_alike"),
    total("microsurface::goniometer::Setup::projected_areas", "areas_are_smiths_integral"),
    total("microsurface::surface::Surface::facets", "anisotropy_changes_no_statistics"),
    total("microsurface::surface::Surface::heights", "anisotropy_changes_no_statistics"),
    total("microsurface::surface::Surface::nx", "anisotropy_changes_no_statistics"),
    total("microsurface::surface::Surface::ny", "anisotropy_changes_no_statistics"),
    total("microsurface::surface::Surface::range", "anisotropy_changes_no_statistics"),
    total("microsurface::surface::Surface::slopes", "anisotropy_changes_no_statistics"),
    total("microsurface::surface::Surface::spacing", "anisotropy_changes_no_statistics"),
    total("microsurface::surface::Surface::stretched", "anisotropy_changes_no_statistics"),
    total("microsurface::surface::Surface::g1", "areas_are_smiths_integral"),
    total("microsurface::surface::Surface::lambda", "areas_are_smiths_integral"),
    total("microsurface::surface::Surface::projected_area", "areas_are_smiths_integral"),
    total("microsurface::surface::Surface::new", "settings_out_of_range_are_named"),
    total("microsurface::trace::Point::facet", "rays_meet_the_first_triangle_in_their_way"),
    total("microsurface::trace::Side::other", "glass_reflects_or_transmits"),
    total("microsurface::trace::Tracer::first", "rays_meet_the_first_triangle_in_their_way"),
    total("microsurface::trace::Tracer::height", "rays_meet_the_first_triangle_in_their_way"),
    total("microsurface::trace::Tracer::new", "rays_meet_the_first_triangle_in_their_way"),
    total("microsurface::trace::Tracer::next", "rays_meet_the_first_triangle_in_their_way"),
    total("microsurface::trace::Tracer::slope", "rays_meet_the_first_triangle_in_their_way"),
    total("microsurface::trace::Tracer::surface", "rays_meet_the_first_triangle_in_their_way"),
];
