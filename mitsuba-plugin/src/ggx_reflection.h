#pragma once

#include <mitsuba/core/frame.h>
#include <mitsuba/core/warp.h>
#include <mitsuba/render/fwd.h>

#include "sgtd_distribution.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * GGX with bounded visible normals, in closed form: the lowest node of the family.
 *
 * In the space where GGX is a sphere, the visible normals of a view i are the half vectors of i and
 * of directions o that are uniform on the cap o.z > -i.z (Dupuy and Benyoub 2023, *Sampling Visible
 * GGX Normals with Spherical Caps*). Reflections that leave the surface come from a smaller cap,
 * o.z > -k i.z with k = (1 - a^2) s^2 / (s^2 + a^2 cos^2), a = min(alpha_u, alpha_v, 1) and s = 1 +
 * sin (Eto and Tokuyoshi 2023, *Bounded VNDF Sampling for Smith-GGX Reflections*). Their density is
 * that of visible normals by the ratio of the two areas.
 */
template <typename Float, typename Spectrum> class GgxReflection {
public:
    MI_IMPORT_TYPES()
    using Reflected        = typename SgtdDistribution<Float, Spectrum>::Reflected;
    using ReflectionSample = typename SgtdDistribution<Float, Spectrum>::ReflectionSample;

    GgxReflection(const Float &alpha_u, const Float &alpha_v)
        : m_alpha_u(dr::maximum(alpha_u, (float)sgtd::host::LeastAlpha)),
          m_alpha_v(dr::maximum(alpha_v, (float)sgtd::host::LeastAlpha)) {}

    template <bool Value, bool Pdf>
    Reflected reflected(const Vector3f &wi, const Vector3f &wo, bool height_correlated) const {
        return reflected(View(*this, wi), wo, height_correlated);
    }

    ReflectionSample sample_reflection(const Vector3f &wi, const Point2f &u,
                                       bool height_correlated) const {
        return sample_reflection(View(*this, wi), u, height_correlated);
    }

    std::pair<Reflected, ReflectionSample> reflected_and_sample(const Vector3f &wi,
                                                                const Vector3f &wo,
                                                                const Point2f &u,
                                                                bool height_correlated) const {
        View view(*this, wi);
        return { reflected(view, wo, height_correlated),
                 sample_reflection(view, u, height_correlated) };
    }

private:
    struct View {
        Vector3f wi, stretched;
        Float length, area;
        /// k cos
        Float depth;

        View(const GgxReflection &distr, const Vector3f &wi_) : wi(wi_) {
            stretched = Vector3f(distr.m_alpha_u * wi.x(), distr.m_alpha_v * wi.y(), wi.z());
            length    = dr::norm(stretched);
            area      = .5f * (wi.z() + length);
            Float a2  = dr::square(dr::minimum(dr::minimum(distr.m_alpha_u, distr.m_alpha_v), 1.f)),
                  sin = dr::safe_sqrt(dr::fmadd(wi.x(), wi.x(), dr::square(wi.y()))),
                  s2  = dr::square(1.f + sin);
            depth     = (1.f - a2) * s2 / dr::fmadd(a2, dr::square(wi.z()), s2) * wi.z();
        }
    };

    /// cos(theta) (1 + Lambda)
    Float projected_area(const Vector3f &w) const {
        return .5f * (w.z() + dr::norm(Vector3f(m_alpha_u * w.x(), m_alpha_v * w.y(), w.z())));
    }

    Float g2(const View &view, const Vector3f &wo, bool height_correlated) const {
        Float area_o = projected_area(wo), z_i = view.wi.z(),
              area = height_correlated ? dr::fmadd(view.area, wo.z(), z_i * (area_o - wo.z()))
                                       : view.area * area_o;
        return z_i * wo.z() / area;
    }

    Reflected reflected(const View &view, const Vector3f &wo, bool height_correlated) const {
        Vector3f h   = view.wi + wo;
        Float square = dr::squared_norm(h),
              slope  = dr::fmadd(dr::square(h.x() / m_alpha_u), 1.f,
                                 dr::fmadd(dr::square(h.y() / m_alpha_v), 1.f, dr::square(h.z()))),
              d      = dr::square(square / slope) * dr::InvPi<Float> / (m_alpha_u * m_alpha_v),
              facing = dr::dot(view.wi, h) * dr::rsqrt(square);
        d            = dr::select(d * h.z() * dr::rsqrt(square) > 1e-20f, d, 0.f);
        return { d, g2(view, wo, height_correlated),
                 2.f * d * facing / (view.depth + view.length) };
    }

    ReflectionSample sample_reflection(const View &view, const Point2f &u,
                                       bool height_correlated) const {
        Float inv_length = dr::rcp(view.length), bottom = view.depth * inv_length,
              z                 = dr::fmsub(1.f - u.x(), 1.f + bottom, bottom),
              sin               = dr::safe_sqrt(dr::fnmadd(z, z, 1.f));
        auto [sin_phi, cos_phi] = dr::sincos(dr::TwoPi<Float> * u.y());
        Vector3f m =
            dr::fmadd(view.stretched, inv_length, Vector3f(sin * cos_phi, sin * sin_phi, z));
        m            = dr::normalize(Vector3f(m_alpha_u * m.x(), m_alpha_v * m.y(), m.z()));
        Vector3f wo  = reflect(view.wi, Normal3f(m));
        Reflected at = reflected(view, wo, height_correlated);
        ReflectionSample result;
        result.m          = m;
        result.pdf        = at.pdf;
        result.d_over_pdf = .5f * (view.depth + view.length) / dr::dot(view.wi, m);
        result.g          = at.g;
        return result;
    }

    Float m_alpha_u, m_alpha_v;
};

NAMESPACE_END(mitsuba)
