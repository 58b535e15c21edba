// Kernel of deblur.hpp. Compiled once per instruction set; therefore, everything has internal linkage.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "deconvolution.hpp"
#include "lanes.hpp"
#include "pool.hpp"
#include "tile.hpp"

namespace omnimirror {
namespace {

// As in dewarp/restoration/_deconvolution.py.
constexpr float EDGE2 = 0.005f * 0.005f, DARK = 1e-4f, MAX_VALUE = 2.0f, SATURATED = 0.995f;

template <class F>
void in_parallel(int count, F f) {
    parallel_for(count, [](void* context, int i) { (*static_cast<F*>(context))(i); }, &f);
}

// -- the quadratic terms -----------------------------------------------------------------------------------

// Squared gradient magnitude over all channels, of values in a row; values are clipped at `most`.
struct Steepness {
    const float *here[3], *right[3], *below[3];

    template <int C>
    float squared(int x, float limit) const {
        const auto cut = [limit](float value) { return value < limit ? value : limit; };
        float square = EDGE2;
        for (int c = 0; c < C; ++c) {
            const float value = cut(here[c][x]), across = cut(right[c][x]) - value, down = cut(below[c][x]) - value;
            square += across * across + down * down;
        }
        return square;
    }
};

// D^T S D applied to a row of values in one channel and position within the pixel, with D the differences and S the
// stiffness.
struct Smoothness {
    const float *here, *left, *right, *above, *below, *stiffness, *stiffness_left, *stiffness_above;

    float operator()(int x) const {
        return stiffness_left[x] * (here[x] - left[x]) + stiffness[x] * (2 * here[x] - right[x] - below[x]) +
               stiffness_above[x] * (here[x] - above[x]);
    }
};

template <int C>
Smoothness smoothness_of(const Work<C>& w, float* plane, int row, int c, int within) {
    const int last = w.f - 1;
    return {w.row_of(plane, row, c, within),
            within > 0 ? w.row_of(plane, row, c, within - 1) : w.row_of(plane, row, c, last) - 1,
            within < last ? w.row_of(plane, row, c, within + 1) : w.row_of(plane, row, c, 0) + 1,
            w.row_of(plane, row - 1, c, within),
            w.row_of(plane, row + 1, c, within),
            w.row_of(w.stiffness, row, within),
            within > 0 ? w.row_of(w.stiffness, row, within - 1) : w.row_of(w.stiffness, row, last) - 1,
            w.row_of(w.stiffness, row - 1, within)};
}

// Load the values before the round.
template <int C>
void load_values(const Work<C>& w) {
    const Box& from = w.tile.values;
    for (int row = w.f * from.top; row < w.f * from.bottom; ++row) {
        const int here = row - w.f * w.top;
        for (int c = 0; c < C; ++c)
            for (int within = 0; within < w.f; ++within)
                std::memcpy(w.row_of(w.fine, here, c, within) + w.values.left,
                            w.s.fine.data() + w.s.place(row, c, within) + from.left,
                            sizeof(float) * static_cast<size_t>(from.right - from.left));
        replicate_ends(w, w.fine, here);
    }
}

template <int C>
void set_stiffness(const Work<C>& w, const float* costs, int row) {
    const int64_t pixels = int64_t{w.s.blur.width} * (w.top + row / w.f) + w.left;
    const float *cost = costs + pixels, *concentration = w.s.blur.concentration.data() + pixels;
    for (int within = 0; within < w.f; ++within) {
        Steepness steepness;
        for (int c = 0; c < C; ++c) {
            const Smoothness near = smoothness_of(w, w.fine, row, c, within);
            steepness.here[c] = near.here, steepness.right[c] = near.right, steepness.below[c] = near.below;
        }
        float *stiffness = w.row_of(w.stiffness, row, within), *scale = w.row_of(w.scale, row, within);
        OMNIMIRROR_COLUMNS(x, w.values) {
            stiffness[x] = cost[x] / std::sqrt(steepness.squared<C>(x, MAX_VALUE));
            scale[x] = 1 / (4 * stiffness[x] + concentration[x]);  // see Blur.concentration
        }
    }
}

OMNIMIRROR_NOINLINE float gradient_of_row(const Smoothness& of_fine, const float* product, const float* scale,
                                          float* residual, const Box& box) {
    const Smoothness smoothness = of_fine;
    float square = 0;
    OMNIMIRROR_COLUMNS(x, box) {
        const float gradient = smoothness.here[x] * product[x] - smoothness(x);
        residual[x] = gradient;
        square += gradient * gradient * scale[x];
    }
    return square;
}

// Compute the residual of the quadratic terms at `fine`; return its scaled square.
template <int C>
double linearise(const Work<C>& w, const float* costs) {
    const int64_t columns = int64_t{GROUP} * w.s.blur.groups();
    double sum = 0;
    sweep(
        w,
        [&](int row) {
            set_stiffness(w, costs, row);
            for (int n = 0; n < C * w.f; ++n) {
                float* image = w.row_of(w.image, row, 0, n);
                const float* fine = w.row_of(w.fine, row, 0, n);
                OMNIMIRROR_COLUMNS(x, w.values) image[x] = fine[x] * fine[x];
            }
        },
        [&](int row, int x, float* blurred) {
            for (int c = 0; c < C; ++c) {
                const float* observed = w.s.observed.data() + columns * (int64_t{C} * (w.top + row) + c) + w.left + x;
                float *slope2 = w.slope2 + w.stride * (int64_t{C} * row + c) + x, *values = blurred + GROUP * c;
                OMNIMIRROR_LANES(i, 0) {
                    const float level = std::sqrt(values[i] > DARK ? values[i] : DARK);
                    const bool counts = observed[i] >= 0 && (observed[i] < SATURATED || level < observed[i]);
                    const float slope = counts ? 1 / level : 0;  // of sqrt(A u^2), without the factors A and u
                    values[i] = slope * (observed[i] - level), slope2[i] = slope * slope;
                }
            }
        },
        [&](int row) {
            for (int c = 0; c < C; ++c)
                for (int within = 0; within < w.f; ++within) {
                    const Smoothness smoothness = smoothness_of(w, w.fine, row, c, within);
                    sum +=
                        gradient_of_row(smoothness, w.row_of(w.product, row, c, within), w.row_of(w.scale, row, within),
                                        w.row_of(w.residual, row, c, within), w.values);
                    std::memset(w.row_of(w.x, row, c, within), 0, sizeof(float) * static_cast<size_t>(w.stride));
                }
        });
    return sum;
}

// Scalar products of H d (H the Hessian): with d, and its scaled square.
struct Products {
    double with_d, square;
};

OMNIMIRROR_NOINLINE void update_row(const float* fine, const float* scale, const float* product, float* residual,
                                    float* x, float* d, float* image, float step, float share, const Box& box) {
    OMNIMIRROR_COLUMNS(i, box) {
        x[i] += step * d[i];
        residual[i] -= step * product[i];
        d[i] = scale[i] * residual[i] + share * d[i];
        image[i] = fine[i] * d[i];
    }
}

OMNIMIRROR_NOINLINE Products products_of_row(const Smoothness& of_d, const float* fine, const float* scale,
                                             float* product, const Box& box) {
    const Smoothness smoothness = of_d;
    float with_d = 0, square = 0;
    OMNIMIRROR_COLUMNS(x, box) {
        const float value = fine[x] * product[x] + smoothness(x);
        product[x] = value;
        with_d += value * smoothness.here[x];
        square += value * value * scale[x];
    }
    return {with_d, square};
}

// Take the last step, set the next direction, which contains a share of the last one, and compute product = Hessian
// times direction.
template <int C>
Products conjugate_step(const Work<C>& w, float step, float share) {
    Products sums{0, 0};
    sweep(
        w,
        [&](int row) {
            for (int c = 0; c < C; ++c)
                for (int within = 0; within < w.f; ++within) {
                    const auto at = [&](float* plane) { return w.row_of(plane, row, c, within); };
                    update_row(at(w.fine), w.row_of(w.scale, row, within), at(w.product), at(w.residual), at(w.x),
                               at(w.d), at(w.image), step, share, w.values);
                }
            replicate_ends(w, w.d, row);
        },
        [&](int row, int x, float* blurred) {
            for (int c = 0; c < C; ++c) {
                const float* slope2 = w.slope2 + w.stride * (int64_t{C} * row + c) + x;
                OMNIMIRROR_LANES(i, 0) blurred[GROUP * c + i] *= slope2[i];
            }
        },
        [&](int row) {
            for (int c = 0; c < C; ++c)
                for (int within = 0; within < w.f; ++within) {
                    const Smoothness smoothness = smoothness_of(w, w.d, row, c, within);
                    const Products of_row =
                        products_of_row(smoothness, w.row_of(w.fine, row, c, within), w.row_of(w.scale, row, within),
                                        w.row_of(w.product, row, c, within), w.values);
                    sums.with_d += of_row.with_d, sums.square += of_row.square;
                }
        });
    return sums;
}

// Write the solution, including the last step, to the image, clipped to [0, MAX_VALUE].
template <int C>
void store_solution(const Work<C>& w, float step) {
    const Box &core = w.tile.core, &values = w.tile.values;
    const int left = std::max(core.left, values.left), right = std::min(core.right, values.right);
    const int top = std::max(core.top, values.top), bottom = std::min(core.bottom, values.bottom);
    for (int row = w.f * top; row < w.f * bottom; ++row)
        for (int c = 0; c < C; ++c) {
            for (int within = 0; within < w.f; ++within) {
                const auto here = [&](float* plane) { return w.row_of(plane, row - w.f * w.top, c, within) - w.left; };
                const float *fine = here(w.fine), *d = here(w.d), *solution = here(w.x);
                float* improved = w.s.improved.data() + w.s.place(row, c, within);
                for (int x = left; x < right; ++x)
                    improved[x] = std::clamp(fine[x] + (solution[x] + step * d[x]), 0.0f, MAX_VALUE);
            }
            if (right == w.s.blur.width) {
                float* first = w.s.improved.data() + w.s.place(row, c, 0);
                first[right] = w.s.improved[static_cast<size_t>(w.s.place(row, c, w.f - 1) + right - 1)];
            }
        }
}

// Conjugate gradients. Consecutive residuals r and r' = r - step product are orthogonal; therefore |r'|^2 = step^2
// |product|^2 - |r|^2.
template <int C>
void improve_tile(const Work<C>& w, const float* costs, int steps) {
    load_values(w);
    double power = linearise(w, costs);
    float step = 0, share = 0;
    for (int n = 0; n < steps && power > 0; ++n) {
        const Products sums = conjugate_step(w, step, share);
        step = static_cast<float>(power / sums.with_d);
        const double before = power;
        power = double{step} * step * sums.square - before;
        share = static_cast<float>(power / before);
    }
    store_solution(w, step);
}

// Copy a tile unchanged, including the repeated column at the right edge of the image.
inline void leave_tile(Deconvolution& s, const Box& core) {
    const int f = s.blur.fineness, end = core.right + (core.right == s.blur.width);
    for (int row = f * core.top; row < f * core.bottom; ++row)
        for (int n = 0; n < s.channels * f; ++n) {
            const int64_t first = s.place(row, 0, n) + core.left;
            std::copy_n(s.fine.data() + first, end - core.left, s.improved.data() + first);
        }
}

template <int C>
void improve_all(Deconvolution& s, const float* costs, const int32_t* steps) {
    in_parallel(static_cast<int>(s.blur.tiles.size()), [&](int i) {
        const TileBoxes& tile = s.blur.tiles[static_cast<size_t>(i)];
        if (steps[i] > 0)
            improve_tile(Work<C>(s, tile), costs, steps[i]);
        else
            leave_tile(s, tile.core);
    });
    std::swap(s.fine, s.improved);
}

// -- evaluation of the image -------------------------------------------------------------------------------

inline float logarithm(float x) {  // accurate to the last bits, in vectorised loops
    const auto bits = std::bit_cast<int32_t>(x);
    const int32_t power = (bits - 0x3f3504f3) >> 23;  // exponent of 2; the rest is sqrt(1/2) to sqrt(2)
    const float rest = std::bit_cast<float>(bits - power * (1 << 23));
    const float r = (rest - 1) / (rest + 1), r2 = r * r;
    return 0.6931472f * static_cast<float>(power) +
           2 * r * (1 + r2 * (1 / 3.0f + r2 * (1 / 5.0f + r2 * (1 / 7.0f + r2 / 9))));
}

template <int C>
void log_all(const Deconvolution& s, float* logarithms) {
    const BlurKernels& k = s.blur;
    in_parallel(k.height, [&](int y) {
        const int f = k.fineness, deep = f * k.height;
        const Box line{y, y + 1, 0, k.width};
        std::vector<float> products(static_cast<size_t>(k.width));
        float* out = logarithms + int64_t{k.width} * y;
        std::fill(out, out + k.width, 0.0f);
        for (int row = f * y; row < f * (y + 1); ++row) {
            std::fill(products.begin(), products.end(), 1.0f);
            for (int within = 0; within < f; ++within) {
                Steepness steepness;
                for (int c = 0; c < C; ++c) {
                    const float* fine = s.fine.data();
                    steepness.here[c] = fine + s.place(row, c, within);
                    steepness.right[c] =
                        within + 1 < f ? fine + s.place(row, c, within + 1) : fine + s.place(row, c, 0) + 1;
                    steepness.below[c] = fine + s.place(row + 1 < deep ? row + 1 : row, c, within);
                }
                float* product = products.data();
                OMNIMIRROR_COLUMNS(x, line) product[x] *= steepness.squared<C>(x, 1.0f);
            }
            const auto share = 1 / static_cast<float>(2 * f * f);
            const float* product = products.data();
            OMNIMIRROR_COLUMNS(x, line) out[x] += share * logarithm(product[x]);
        }
    });
}

template <int C>
void blurred_tile(const Work<C>& w, float* light) {
    const BlurKernels& k = w.s.blur;
    load_values(w);
    for (int row = w.f * w.values.top; row < w.f * w.values.bottom; ++row) {
        for (int n = 0; n < C * w.f; ++n) {
            float* image = w.row_of(w.image, row, 0, n);
            const float* fine = w.row_of(w.fine, row, 0, n);
            OMNIMIRROR_COLUMNS(x, w.values) image[x] = fine[x] * fine[x];
        }
        replicate_edge(w, row);
    }
    const Box& core = w.tile.core;
    for (int row = std::max(core.top - w.top, w.modelled.top); row < std::min(core.bottom - w.top, w.modelled.bottom);
         ++row)
        for_groups(w, row, [&](const Group& group, int64_t place, int x) {
            float blurred[C * GROUP];
            blur<C>(group, w.image + place, w.f * w.stride, blurred);
            for (int i = 0; i < GROUP; ++i) {
                const int column = w.left + x + i;
                const int64_t pixel = int64_t{k.width} * (w.top + row) + column;
                if (column < core.left || column >= core.right || !k.known[static_cast<size_t>(pixel)]) continue;
                for (int c = 0; c < C; ++c) light[C * pixel + c] = blurred[GROUP * c + i];
            }
        });
}

template <int C>
void blurred_all(Deconvolution& s, float* light) {
    in_parallel(static_cast<int>(s.blur.tiles.size()),
                [&](int i) { blurred_tile(Work<C>(s, s.blur.tiles[static_cast<size_t>(i)]), light); });
}

template <int C>
void light_all(const Deconvolution& s, float* light) {
    const BlurKernels& k = s.blur;
    in_parallel(k.height, [&](int y) {
        const int f = k.fineness;
        const Box line{y, y + 1, 0, k.width};
        std::vector<float> means(static_cast<size_t>(k.width));
        for (int c = 0; c < C; ++c) {
            std::fill(means.begin(), means.end(), 0.0f);
            for (int n = 0; n < f * f; ++n) {
                const float* fine = s.fine.data() + s.place(f * y + n / f, c, n % f);
                float* mean = means.data();
                OMNIMIRROR_COLUMNS(x, line) mean[x] += fine[x] * fine[x] / static_cast<float>(f * f);
            }
            float* out = light + int64_t{C} * k.width * y + c;
            for (int x = 0; x < k.width; ++x) out[C * x] = means[static_cast<size_t>(x)];
        }
    });
}

// -- for any number of channels ----------------------------------------------------------------------------

void improve(Deconvolution& s, const float* costs, const int32_t* steps) {
    s.channels == 1 ? improve_all<1>(s, costs, steps) : improve_all<3>(s, costs, steps);
}

void log_steepness(const Deconvolution& s, float* logarithms) {
    s.channels == 1 ? log_all<1>(s, logarithms) : log_all<3>(s, logarithms);
}

void blurred(Deconvolution& s, float* light) { s.channels == 1 ? blurred_all<1>(s, light) : blurred_all<3>(s, light); }

void light(const Deconvolution& s, float* light) { s.channels == 1 ? light_all<1>(s, light) : light_all<3>(s, light); }

}  // namespace
}  // namespace omnimirror
