#pragma once

#include <algorithm>
#include <memory>
#include <optional>

#include "ggx_reflection.h"
#include "sgtd_bsdf.h"
#include "sgtd_multiple_scattering.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * What BSDFs have in common whose facets reflect and nothing else: which facets these are, their
 * single scattering, and what it loses.
 */
template <typename Float, typename Spectrum> class SgtdReflecting
    : public SgtdBSDF<Float, Spectrum> {
public:
    MI_IMPORT_BASE(SgtdBSDF, m_alpha_u, m_alpha_v, m_anisotropic, m_height_correlated, m_builtin,
                   m_ndf, m_node, m_plugin, changed, constant, normals, with_tables)
    MI_IMPORT_TYPES()

    void parameters_changed(const std::vector<std::string> &keys = {}) override {
        const sgtd::host::RowShape before                 = m_node;
        const std::shared_ptr<const sgtd::host::Ndf> held = m_ndf;
        Base::parameters_changed(keys);
        for (const char *name : { "alpha_u", "alpha_v" })
            if (m_missing_energy.fixed && recording<Float>() && string::contains(keys, name))
                Throw("parameter \"%s\" cannot be changed inside a frozen function where "
                      "multiple_scattering is on, as it has a table for two roughnesses: change it "
                      "before the call",
                      name);
        bool pair = changed(keys, "alpha_u") || changed(keys, "alpha_v");
        if (!(m_node == before) || m_ndf != held ||
            (m_missing_energy.fixed && pair && !recording<Float>()))
            update_missing_energy();
    }

protected:
    SgtdReflecting(const Properties &props) : Base(props, true) {
        m_multiple_scattering = props.get<bool>("multiple_scattering", false);
        update_missing_energy();
    }

    const char *no_gradient() const override {
        return m_multiple_scattering
                   ? "multiple_scattering is on, whose tables have no derivatives: turn it off to "
                     "differentiate by a parameter of the distribution other than alpha"
                   : nullptr;
    }

    void describe(std::ostream &os) const {
        Base::describe(os);
        os << "  multiple_scattering = " << (bool)m_multiple_scattering << "," << std::endl;
    }

    // ------------------------------------------------------------------
    //  The distribution on the host
    // ------------------------------------------------------------------

    /// The distribution as the core has it; Mitsuba's own have no tables of ours.
    std::shared_ptr<const sgtd::host::Ndf> core_ndf() const {
        return m_ndf ? m_ndf
                     : sgtd::host::Ndf::get(m_node.shape, sgtd::host::DefaultAccuracy, false);
    }

    /// A roughness as it is there.
    double core_alpha(double alpha) const {
        return std::max(alpha * m_node.alpha_scale, sgtd::host::LeastAlpha);
    }

    /// Makes the table of what single scattering loses, if it is to be returned.
    void update_missing_energy() {
        if (!m_multiple_scattering)
            return;
        using MultipleScattering                   = SgtdMultipleScattering<Float>;
        std::shared_ptr<const sgtd::host::Ndf> ndf = core_ndf();
        // A roughness that is no number counts as one that varies
        std::optional<double> u = constant(m_alpha_u.get()), v = constant(m_alpha_v.get());
        if (m_anisotropic && u && v) {
            double alpha_u = core_alpha(*u), alpha_v = core_alpha(*v);
            m_missing_energy = MultipleScattering::load(
                ndf->missing_energy(m_height_correlated, alpha_u, alpha_v), alpha_u, alpha_v);
        } else {
            m_missing_energy = MultipleScattering::load(ndf->missing_energy(m_height_correlated));
        }
        m_pair = m_missing_energy.fixed;
        if (m_missing_energy.source->reached > 1e-3)
            Log(Warn,
                "%s: with multiple_scattering, the share of light that single "
                "scattering keeps is off by up to %g for this shape, and a white furnace by as "
                "much. A lower shift or p%s makes it smaller.",
                m_plugin, m_missing_energy.source->reached,
                m_missing_energy.fixed ? ", or one alpha instead of two," : "");
    }

    // ------------------------------------------------------------------
    //  Evaluation
    // ------------------------------------------------------------------

    /// Calls `f` with the facets at a place.
    template <typename Function>
    auto with_facets(const SurfaceInteraction3f &si, const Mask &active, const Function &f) const {
        return Base::template with_facets<BuiltinFacets<Float, Spectrum>>(
            si, active,
            [&](const Float &alpha_u, const Float &alpha_v, const auto &f_) {
                return own_facets(alpha_u, alpha_v, f_);
            },
            f);
    }

    /// The same for those that are not Mitsuba's own.
    template <typename Function>
    auto own_facets(const Float &alpha_u, const Float &alpha_v, const Function &f) const {
        using Closed = GgxReflection<Float, Spectrum>;
        using Tables = SgtdDistribution<Float, Spectrum>;
        if (m_builtin)
            return f(ReflectingFacets<Float, Spectrum, Closed>(
                alpha_u, alpha_v, m_height_correlated, alpha_u, alpha_v));
        return with_tables(alpha_u, [&](const SgtdTables<Float> &tables) {
            return f(ReflectingFacets<Float, Spectrum, Tables>(
                alpha_u * tables.alpha_scale, alpha_v * tables.alpha_scale, m_height_correlated,
                *m_ndf, tables, alpha_u, alpha_v, normals(), !m_anisotropic));
        });
    }

    /// The roughness as the table of missing energy knows it.
    template <typename Facets> auto loss_surface(const Facets &facets) const {
        const auto least = (ScalarFloat)sgtd::host::LeastAlpha;
        return m_missing_energy.surface(dr::maximum(facets.alpha_u(), least),
                                        dr::maximum(facets.alpha_v(), least));
    }

    /// Is the facet `m` seen from its front side from both directions?
    static Mask reflects(const Vector3f &wi, const Vector3f &wo, const Vector3f &m) {
        return Frame3f::cos_theta(wi) > 0.f && Frame3f::cos_theta(wo) > 0.f &&
               dr::dot(wi, m) > 0.f && dr::dot(wo, m) > 0.f;
    }

    /// Value and density of single scattering; `color` makes the value from that of perfect
    /// mirrors, where there is any.
    template <bool Value, bool Pdf, typename Facets, typename At, typename Color>
    static std::pair<Spectrum, Float> single_scattering(const Facets &facets, const At &at,
                                                        const Vector3f &wi, const Vector3f &wo,
                                                        Mask active, const Color &color) {
        Float cos_theta_i = Frame3f::cos_theta(wi), pdf = 0.f;
        active   = facets.defined(active, cos_theta_i, Frame3f::cos_theta(wo));
        Mask lit = active;
        Spectrum value(0.f);
        if constexpr (Value) {
            UnpolarizedSpectrum result = at.d * at.g / (4.f * cos_theta_i);
            lit                        = facets.lit(active, at.d, dr::all(dr::isfinite(result)));
            value                      = color(result, lit) & lit;
        }
        if constexpr (Pdf)
            pdf = dr::select(facets.dense(active, lit, at.pdf), at.pdf, 0.f);
        return { value, pdf };
    }

protected:
    FrozenChoice<Float> m_multiple_scattering;
    /// Is the table of missing energy that of two roughnesses?
    FrozenChoice<Float> m_pair;
    /// Empty unless light is scattered more than once
    SgtdMultipleScattering<Float> m_missing_energy;

    MI_TRAVERSE_CB(Base, m_multiple_scattering, m_pair, m_missing_energy)
};

NAMESPACE_END(mitsuba)
