#pragma once

#include <array>
#include <memory>
#include <vector>

#include <drjit/custom.h>
#include <mitsuba/core/fwd.h>
#include <mitsuba/core/logger.h>

#include "bridge.h"
#include "frozen_choice.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * The product of a matrix, of which there is a part for each of some lists of numbers, with the
 * changes of the numbers' logarithms: 0 for the numbers as they are, with a gradient.
 *
 * This is one operation of its own because Dr.Jit takes forward derivatives in the order of their
 * sources: those of a chain of operations would be ready only after renders, which see the numbers
 * and not the chain, have asked for them.
 */
template <typename Float> class NumbersProduct final : public dr::detail::CustomOpBase {
public:
    using FloatBuffer = DynamicBuffer<Float>;
    using Detached    = dr::detached_t<FloatBuffer>;
    using Index       = dr::uint32_array_t<Detached>;

    /// A list of numbers with a gradient, and its part of the matrix, column after column.
    struct Part {
        FloatBuffer numbers;
        Detached columns;
    };

    /// The product; `open` becomes false when the way back to the numbers has been taken.
    static FloatBuffer make(const std::vector<Part> &parts, size_t rows,
                            const std::shared_ptr<bool> &open) {
        nanobind::ref<NumbersProduct> op = new NumbersProduct(rows, open);
        for (const Part &part : parts)
            if (op->add_index(dr::backend_v<FloatBuffer>, part.numbers.index_ad(), true)) {
                const Detached size = dr::detach<false>(part.numbers);
                // A value of 0 has no logarithm and stays 0
                op->m_inputs.push_back(
                    { part.numbers.index_ad(), part.columns,
                      dr::select(size > 0.f, 1.f / dr::maximum(size, 1e-37f), 0.f) });
            }
        FloatBuffer result = dr::zeros<FloatBuffer>(rows);
        result.new_grad_();
        // Dr.Jit counts on two references to a result by its operation
        op->m_output = FloatBuffer::borrow((uint64_t)result.index_ad() << 32);
        op->add_index(dr::backend_v<FloatBuffer>, result.index_ad(), false);
        if (!ad_custom_op(op.get()))
            dr::disable_grad(result);
        return result;
    }

    ~NumbersProduct() override { *m_open = m_is_forward; }

    void forward() override {
        m_is_forward = true;
        Detached sum = dr::zeros<Detached>(m_rows);
        for (const Input &input : m_inputs) {
            const size_t count   = dr::width(input.inverse);
            const Detached moved = grad(input.index) * input.inverse;
            const Index at       = dr::arange<Index>(m_rows * count);
            dr::scatter_reduce(ReduceOp::Add, sum, input.columns * dr::repeat(moved, m_rows),
                               at % (uint32_t)m_rows);
        }
        // What an earlier pass left there: the end of a chain is cleared by nobody else
        ad_clear_grad((uint64_t)m_output.index_ad() << 32);
        accumulate(m_output.index_ad(), sum);
    }

    void backward() override {
        if (m_is_forward)
            Throw(
                "sgtd: a forward pass has left its derivatives where a backward pass would collect "
                "its own: call set_dirty() and update() of the scene's parameters between them");
        const Detached by = grad(m_output.index_ad()) + dr::zeros<Detached>(m_rows);
        for (const Input &input : m_inputs) {
            const size_t count = dr::width(input.inverse);
            accumulate(input.index,
                       dr::block_sum(input.columns * dr::tile(by, count), m_rows) * input.inverse);
        }
    }

    const char *name() const override { return "sgtd: numbers of a distribution"; }

private:
    struct Input {
        uint32_t index;
        Detached columns, inverse;
    };

    NumbersProduct(size_t rows, const std::shared_ptr<bool> &open) : m_rows(rows), m_open(open) {}

    static Detached grad(uint32_t index) {
        return Detached::steal(ad_grad((uint64_t)index << 32, true));
    }

    static void accumulate(uint32_t index, const Detached &value) {
        ad_accum_grad((uint64_t)index << 32, value.index());
    }

    size_t m_rows;
    std::vector<Input> m_inputs;
    FloatBuffer m_output;
    std::shared_ptr<bool> m_open;
    /// A forward pass that is under way has forgotten this operation already
    bool m_is_forward = false;
};

/**
 * How a table follows its values, or a mixture its weights and roughnesses: there only if one of
 * these lists has a gradient.
 *
 * All that traced code evaluates is linear in small changes of the numbers. So the core gives a
 * matrix, and its product with the changes of their logarithms is one list of cubics, one for each
 * cell of the masking table and of f. These are 0 and carry the gradient: whoever has found a cell
 * reads its change there, whatever the number of numbers, and the way back is one product for all
 * that was evaluated.
 */
template <typename Float_> struct NumbersGradient {
    using Float       = Float_;
    using UInt32      = dr::uint32_array_t<Float>;
    using FloatBuffer = DynamicBuffer<Float>;
    using Cubic       = dr::Array<Float, 4>;
    /// Lists of numbers: the values of a table, or the weights and the roughnesses of a mixture
    static constexpr size_t Lists = 2;
    using Shown                   = std::array<FloatBuffer, Lists>;

    /// Is there a gradient?
    FrozenChoice<Float> any;
    /// Is the roughness fixed, so that the distribution is scaled back to that mean slope?
    FrozenChoice<Float> scaled;
    /// What the numbers change: of the logarithm of the mean slope; and in fours, for each cell of
    /// the masking table, of f, and of f in double precision
    FloatBuffer changes;
    /// What to add to the number of a cell of f: the position of its cubic
    UInt32 to_cubic, to_precise_cubic;

    /// `precise`: is f evaluated in double precision?
    static NumbersGradient load(const sgtd::host::Ndf &ndf, bool precise, const Shown &shown) {
        const sgtd::host::NumbersGradient core = ndf.numbers_gradient(precise);
        NumbersGradient result;
        result.any                = true;
        result.m_rows             = core.matrix.size() / core.columns;
        const uint32_t cells_of_h = (uint32_t)core.cells_of_h,
                       cells_of_f = (uint32_t)core.cells_of_f;
        result.to_cubic           = 1u + cells_of_h - (uint32_t)core.first;
        result.to_precise_cubic   = 1u + cells_of_h + cells_of_f - (uint32_t)core.first_precise;
        dr::make_opaque(result.to_cubic, result.to_precise_cubic);
        size_t from = 0;
        for (size_t i = 0; i < Lists; ++i) {
            const size_t count = dr::width(shown[i]);
            std::vector<float> columns(result.m_rows * count);
            for (size_t row = 0; row < result.m_rows; ++row)
                for (size_t k = 0; k < count; ++k)
                    columns[k * result.m_rows + row] = core.matrix[row * core.columns + from + k];
            if (count > 0)
                result.m_columns[i] = dr::load<FloatBuffer>(columns.data(), columns.size());
            from += count;
        }
        return result;
    }

    /// Ties the changes to these numbers, of which some have a gradient.
    void tie(const Shown &shown) {
        if constexpr (dr::is_diff_v<Float>) {
            using Product = NumbersProduct<Float>;
            std::vector<typename Product::Part> parts;
            for (size_t i = 0; i < Lists; ++i) {
                m_tied_to[i] = shown[i].index_ad();
                if (m_tied_to[i])
                    parts.push_back({ shown[i], dr::detach<false>(m_columns[i]) });
            }
            m_open  = std::make_shared<bool>(true);
            changes = Product::make(parts, m_rows, m_open);
        } else {
            DRJIT_MARK_USED(shown);
        }
    }

    /// Are the changes tied to this list?
    bool is_tied_to(size_t i, const FloatBuffer &shown) const {
        return any && shown.index_ad() == m_tied_to[i];
    }

    /// Would a gradient still find its way to the numbers? A backward pass takes it.
    bool is_open() const { return *m_open; }

    /// The change of the logarithm of the mean slope.
    Float log_mean() const { return dr::gather<Float>(changes, UInt32(0u)); }

    /// The change of H in a cell, at the distance `d` from its left end.
    Float masking(const UInt32 &cell, const Float &d) const { return at(cell + 1u, d); }

    /// The change of ln(A f) in a cell of f, at log2 t.
    Float log_density(const UInt32 &cell, const Float &log_t) const {
        return at(cell + to_cubic, log_t);
    }

    /// The same in a cell of f in double precision.
    Float precise_log_density(const UInt32 &cell, const Float &log_t) const {
        return at(cell + to_precise_cubic, log_t);
    }

private:
    Float at(const UInt32 &position, const Float &x_) const {
        Float x = dr::detach(x_);
        Cubic c = dr::gather<Cubic>(changes, position);
        return dr::fmadd(x, dr::fmadd(x, dr::fmadd(x, c[3], c[2]), c[1]), c[0]);
    }

    size_t m_rows = 0;
    std::array<FloatBuffer, Lists> m_columns;
    /// The variables that `changes` was made from, and whether it still is
    std::array<uint32_t, Lists> m_tied_to = {};
    std::shared_ptr<bool> m_open;

public:
    DRJIT_STRUCT(NumbersGradient, any, scaled, changes, to_cubic, to_precise_cubic)
};

NAMESPACE_END(mitsuba)
