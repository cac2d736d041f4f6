#pragma once

#include <cmath>
#include <string>

#include <mitsuba/core/properties.h>
#include <mitsuba/render/ior.h>

#include "frozen_choice.h"

NAMESPACE_BEGIN(mitsuba)

/// An index of refraction, given as a number or as the name of a material.
inline double refraction_index(const Properties &props, const char *name,
                               const char *default_material) {
    Properties::Type type = props.has_property(name) ? props.type(name) : Properties::Type::String;
    if (type == Properties::Type::String) {
        try {
            return lookup_ior(props, name, std::string(default_material));
        } catch (const std::exception &error) {
            Throw("parameter \"%s\" is \"%s\": choose a number, or one of Mitsuba's materials, "
                  "such as bk7 (%s)",
                  name, props.get<std::string_view>(name), error.what());
        }
    }
    double value = props.get<double>(name);
    if (!std::isfinite(value) || value <= 0.0)
        Throw("parameter \"%s\" is %s, but must be a finite number above 0", name, value);
    return value;
}

/// Refuses a bad relative index, if it can be read now.
template <typename Float> void check_eta(const Float &eta) {
    if (recording<Float>())
        return;
    if (dr::width(eta) != 1)
        Throw("parameter \"eta\" is an array of %s numbers, but must be one number",
              dr::width(eta));
    double value = (double)dr::slice(dr::detach(eta));
    if (!std::isfinite(value) || value <= 0.0)
        Throw("parameter \"eta\" is %s, but must be a finite number above 0", value);
}

NAMESPACE_END(mitsuba)
