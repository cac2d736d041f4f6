#pragma once

#include <mitsuba/core/fwd.h>

NAMESPACE_BEGIN(mitsuba)

/// Is a frozen function being recorded? Its variables have no values then that could be read.
template <typename Float> bool recording() {
    if constexpr (dr::is_jit_v<Float>)
        return jit_flag(JitFlag::FreezingScope);
    else
        return false;
}

/**
 * A choice between two pieces of code, made on the host, that frozen functions see.
 *
 * Dr.Jit finds the recording to replay by the number and the types of the variables that its
 * arguments hold, and not by what else the host knows. So a choice always holds one variable, whose
 * type is what was chosen: choices that stand in front of all other members are a code word, and
 * each combination of them has its own.
 */
template <typename Float_> class FrozenChoice {
public:
    using Float  = Float_;
    using Mask   = dr::mask_t<Float>;
    using UInt32 = dr::uint32_array_t<Float>;

    FrozenChoice &operator=(bool value) {
        m_value = value;
        if constexpr (dr::is_jit_v<Float>) {
            if (value && dr::width(m_yes) == 0) {
                m_yes = dr::opaque<Mask>(true);
                m_no  = UInt32();
            } else if (!value && dr::width(m_no) == 0) {
                m_yes = Mask();
                m_no  = dr::opaque<UInt32>(0);
            }
        }
        return *this;
    }

    operator bool() const { return m_value; }

private:
    bool m_value = false;
    /// Exactly one of the two is there
    Mask m_yes  = Mask();
    UInt32 m_no = UInt32();

public:
    DRJIT_STRUCT(FrozenChoice, m_yes, m_no)
};

NAMESPACE_END(mitsuba)
