// The kernel of deblur.hpp. Compiled once per instruction set, so everything here has internal linkage.
#pragma once

#include <cmath>
#include <cstring>

#include "deblur.hpp"
#include "pool.hpp"

namespace omnimirror {
namespace {

// As in deconvolution.py
constexpr float EDGE2 = 0.005f * 0.005f, DARK = 1e-4f, BRIGHTEST = 2.0f, SATURATED = 0.995f;

using Lanes = float __attribute__((vector_size(4 * RUN_LANES)));
using Half = float __attribute__((vector_size(2 * RUN_LANES)));

inline Lanes load(const float* from) {
    Lanes lanes;
    std::memcpy(&lanes, from, sizeof lanes);
    return lanes;
}

inline void store(float* to, Lanes lanes) { std::memcpy(to, &lanes, sizeof lanes); }

inline float total(Lanes lanes) {
    Half halves[2];
    std::memcpy(halves, &lanes, sizeof lanes);
    const Half four = halves[0] + halves[1];
    return (four[0] + four[2]) + (four[1] + four[3]);
}

inline int clamped(int i, int count) { return i < 0 ? 0 : i < count ? i : count - 1; }

template <class F>
void in_parallel(int count, F f) {
    parallel_for(count, [](void* context, int i) { (*static_cast<F*>(context))(i); }, &f);
}

// The sum of f(row) over the rows of the fine grid, in an order that does not depend on the number of threads.
template <class F>
double sum_of_rows(Sharpening& s, F f) {
    double* sums = s.sums.data();
    const int rows = s.blur.deep();
    in_parallel(rows, [&](int row) { sums[row] = f(row); });
    double sum = 0;
    for (int row = 0; row < rows; ++row) sum += sums[row];
    return sum;
}

// How far x is over the inverse of the diagonal of the second derivative, about.
inline float scale_of(float stiffness, float diagonal) { return 1 / (4 * stiffness + diagonal); }

inline float diagonal_of(const BlurKernels& k) {
    const auto f = static_cast<float>(k.fineness);
    return 0.5f / (f * f * f * f);
}

template <int C>
struct Line {  // a row of a plane, in all channels
    float* channel[C];
};

template <int C>
Line<C> line_of(const Sharpening& s, float* plane, int row) {
    Line<C> line;
    for (int c = 0; c < C; ++c) line.channel[c] = plane + (int64_t{C} * row + c) * s.stride;
    return line;
}

// -- the blur ----------------------------------------------------------------------------------------------

// Calls f(place in a plane, weights, count) for the runs of a pixel, whose weights are filled up with zeros. What would
// lie outside the picture is taken from its edge: g(place, weight), one by one.
template <int C, class F, class G>
inline void for_runs(const Sharpening& s, const Visit& visit, F f, G g) {
    const BlurKernels& k = s.blur;
    const int y = visit.row * k.fineness, x = visit.column * k.fineness, deep = k.deep(), across = k.across();
    const int64_t stride = C * s.stride, first = stride * y + x;
    const Run* run = k.runs.data() + k.first_runs[static_cast<size_t>(visit.kernel)];
    const Run* const end = k.runs.data() + k.first_runs[static_cast<size_t>(visit.kernel) + 1];
    const float* const all = k.weights.data();
    if (y + k.least_down >= 0 && y + k.most_down < deep && x + k.least_right >= 0 && x + k.most_right < across) {
        for (; run < end; ++run) f(first + stride * run->down + run->right, all + run->weight, run->count);
        return;
    }
    for (; run < end; ++run) {
        const int64_t row = stride * clamped(y + run->down, deep);
        for (int j = 0; j < run->count; ++j) g(row + clamped(x + run->right + j, across), all[run->weight + j]);
    }
}

// b_i = sum_j A_ij f_j of one pixel i: f the image, A its kernel.
template <int C>
inline void blur_pixel(const Sharpening& s, const Visit& visit, float* blurred) {
    const float* const image = s.image;
    const int64_t stride = s.stride;
    Lanes sums[C] = {};
    float rest[C] = {};
    for_runs<C>(
        s, visit,
        [&](int64_t place, const float* weights, int count) {
            const float* values = image + place;
            for (int j = 0; j < count; j += RUN_LANES)
                for (int c = 0; c < C; ++c) sums[c] += load(weights + j) * load(values + c * stride + j);
        },
        [&](int64_t place, float weight) {
            for (int c = 0; c < C; ++c) rest[c] += weight * image[place + c * stride];
        });
    for (int c = 0; c < C; ++c) blurred[c] = total(sums[c]) + rest[c];
}

// p_j += A_ij b_i of one pixel i, the transpose.
template <int C>
inline void spread_pixel(const Sharpening& s, const Visit& visit, const float* blurred) {
    float* const product = s.product;
    const int64_t stride = s.stride;
    float factors[C];
    for (int c = 0; c < C; ++c) factors[c] = blurred[c];
    for_runs<C>(
        s, visit,
        [&](int64_t place, const float* weights, int count) {
            float* values = product + place;
            for (int j = 0; j < count; j += RUN_LANES) {
                const Lanes lanes = load(weights + j);
                for (int c = 0; c < C; ++c) {
                    float* at = values + c * stride + j;
                    store(at, load(at) + lanes * factors[c]);
                }
            }
        },
        [&](int64_t place, float weight) {
            for (int c = 0; c < C; ++c) product[place + c * stride] += weight * factors[c];
        });
}

// p = A^T f(A image): f(visit, values) changes the values of a pixel. Patches of one colour at a time: these do not touch
// each other's values, and the order of sums is fixed.
template <int C, class F>
void blur_and_spread(Sharpening& s, F f) {
    const BlurKernels& k = s.blur;
    in_parallel(k.deep(), [&](int row) {
        const auto line = line_of<C>(s, s.product, row);
        const Span span = k.spans[static_cast<size_t>(row)];
        for (int c = 0; c < C; ++c)
            std::memset(line.channel[c] + span.begin, 0, sizeof(float) * static_cast<size_t>(span.end - span.begin));
    });
    for (int colour = 0; colour < COLOURS; ++colour) {
        const Patch* patches = k.patches.data() + k.first_patches[colour];
        in_parallel(k.first_patches[colour + 1] - k.first_patches[colour], [&](int patch) {
            for (int64_t i = patches[patch].begin; i < patches[patch].end; ++i) {
                const Visit& visit = k.visits[static_cast<size_t>(i)];
                float values[C];
                blur_pixel<C>(s, visit, values);
                f(i, values);
                spread_pixel<C>(s, visit, values);
            }
        });
    }
}

// -- the quadratic terms -----------------------------------------------------------------------------------

// The square of the steepness of all channels together, from a column to the next; `most` cuts off what is brighter.
template <int C, class F>
inline void for_steepness(const Sharpening& s, int row, int begin, int end, float most, F f) {
    const auto here = line_of<C>(s, s.fine, row), below = line_of<C>(s, s.fine, row + 1 < s.blur.deep() ? row + 1 : row);
    const auto cut = [most](float value) { return value < most ? value : most; };
    for (int x = begin; x < end; ++x) {
        float square = EDGE2;
        for (int c = 0; c < C; ++c) {
            const float value = cut(here.channel[c][x]);
            const float right = cut(here.channel[c][x + 1]) - value, down = cut(below.channel[c][x]) - value;
            square += right * right + down * down;
        }
        f(x, square);
    }
}

// Of a row of d in one channel, times differences' transpose, stiffness and differences.
struct Smoothness {
    const float *here, *above, *below, *stiffness, *stiffness_above;

    float operator()(int x) const {
        return stiffness[x - 1] * (here[x] - here[x - 1]) + stiffness[x] * (2 * here[x] - here[x + 1] - below[x]) +
               stiffness_above[x] * (here[x] - above[x]);
    }
};

// Beyond the picture its values go on: rows are lengthened by one (see lengthen), and end at their own values.
template <int C>
Smoothness smoothness_of(const Sharpening& s, float* plane, int row, int c) {
    const int above = row > 0 ? row - 1 : 0, below = row + 1 < s.blur.deep() ? row + 1 : row;
    return {line_of<C>(s, plane, row).channel[c],    line_of<C>(s, plane, above).channel[c],
            line_of<C>(s, plane, below).channel[c],  s.stiffness + s.stride * row,
            s.stiffness + s.stride * above};
}

inline void lengthen(const Sharpening& s, float* row, Span span) {
    if (span.end == s.blur.across()) row[span.end] = row[span.end - 1];
}

template <int C>
void set_stiffness(Sharpening& s, const float* costs) {
    in_parallel(s.blur.deep(), [&](int row) {
        const int f = s.blur.fineness;
        const Span span = s.blur.spans[static_cast<size_t>(row)];
        const float* cost = costs + int64_t{s.blur.width} * (row / f);
        float* stiffness = s.stiffness + s.stride * row;
        for_steepness<C>(s, row, span.begin, span.end, BRIGHTEST,
                         [&](int x, float square) { stiffness[x] = 1 / std::sqrt(square); });
        for (int x = span.begin; x < span.end; ++x) stiffness[x] *= cost[x / f];
    });
}

// The residual of the quadratic terms about `fine`, and the first direction; returns the residual's scaled square.
template <int C>
double begin_round(Sharpening& s) {
    const BlurKernels& k = s.blur;
    in_parallel(k.deep(), [&](int row) {
        const Span span = k.spans[static_cast<size_t>(row)];
        const auto fine = line_of<C>(s, s.fine, row), image = line_of<C>(s, s.image, row);
        for (int c = 0; c < C; ++c)
            for (int x = span.begin; x < span.end; ++x) image.channel[c][x] = fine.channel[c][x] * fine.channel[c][x];
    });
    const auto pixels = static_cast<int64_t>(k.visits.size());
    blur_and_spread<C>(s, [&](int64_t i, float* values) {
        for (int c = 0; c < C; ++c) {
            const float seen = s.seen[c * pixels + i], level = std::sqrt(values[c] > DARK ? values[c] : DARK);
            const float slope = seen < SATURATED || level < seen ? 1 / level : 0;  // of sqrt(A u^2), but for A and u
            values[c] = slope * (seen - level);
            s.slope2[c * pixels + i] = slope * slope;
        }
    });
    return sum_of_rows(s, [&](int row) {
        const Span span = k.spans[static_cast<size_t>(row)];
        const float diagonal = diagonal_of(k), *stiffness = s.stiffness + s.stride * row;
        float sum = 0;
        for (int c = 0; c < C; ++c) {
            const Smoothness smoothness = smoothness_of<C>(s, s.fine, row, c);
            const float *fine = smoothness.here, *product = line_of<C>(s, s.product, row).channel[c];
            float *d = line_of<C>(s, s.d, row).channel[c], *x = line_of<C>(s, s.x, row).channel[c];
            float *residual = line_of<C>(s, s.residual, row).channel[c], *image = line_of<C>(s, s.image, row).channel[c];
            for (int i = span.begin; i < span.end; ++i) {
                const float pull = fine[i] * product[i] - smoothness(i), scaled = scale_of(stiffness[i], diagonal) * pull;
                residual[i] = pull, d[i] = scaled, image[i] = fine[i] * scaled, x[i] = 0;
                sum += pull * scaled;
            }
            lengthen(s, d, span);
        }
        return static_cast<double>(sum);
    });
}

// product = the second derivative of the quadratic terms times d; returns its scalar product with d.
template <int C>
double times(Sharpening& s) {
    const auto pixels = static_cast<int64_t>(s.blur.visits.size());
    blur_and_spread<C>(s, [&](int64_t i, float* values) {
        for (int c = 0; c < C; ++c) values[c] *= s.slope2[c * pixels + i];
    });
    return sum_of_rows(s, [&](int row) {
        const Span span = s.blur.spans[static_cast<size_t>(row)];
        float sum = 0;
        for (int c = 0; c < C; ++c) {
            const Smoothness smoothness = smoothness_of<C>(s, s.d, row, c);
            const float* fine = line_of<C>(s, s.fine, row).channel[c];
            float* product = line_of<C>(s, s.product, row).channel[c];
            for (int i = span.begin; i < span.end; ++i) {
                product[i] = fine[i] * product[i] + smoothness(i);
                sum += product[i] * smoothness.here[i];
            }
        }
        return static_cast<double>(sum);
    });
}

// The residual after a step; returns its scaled square.
template <int C>
double shrink(Sharpening& s, float step) {
    return sum_of_rows(s, [&](int row) {
        const Span span = s.blur.spans[static_cast<size_t>(row)];
        const float diagonal = diagonal_of(s.blur), *stiffness = s.stiffness + s.stride * row;
        float sum = 0;
        for (int c = 0; c < C; ++c) {
            const float* product = line_of<C>(s, s.product, row).channel[c];
            float* residual = line_of<C>(s, s.residual, row).channel[c];
            for (int i = span.begin; i < span.end; ++i) {
                residual[i] -= step * product[i];
                sum += residual[i] * residual[i] * scale_of(stiffness[i], diagonal);
            }
        }
        return static_cast<double>(sum);
    });
}

// The step is taken, and the next direction keeps a share of the last.
template <int C>
void turn(Sharpening& s, float step, float share) {
    in_parallel(s.blur.deep(), [&](int row) {
        const Span span = s.blur.spans[static_cast<size_t>(row)];
        const float diagonal = diagonal_of(s.blur), *stiffness = s.stiffness + s.stride * row;
        for (int c = 0; c < C; ++c) {
            const float *fine = line_of<C>(s, s.fine, row).channel[c], *residual = line_of<C>(s, s.residual, row).channel[c];
            float *d = line_of<C>(s, s.d, row).channel[c], *x = line_of<C>(s, s.x, row).channel[c];
            float* image = line_of<C>(s, s.image, row).channel[c];
            for (int i = span.begin; i < span.end; ++i) {
                x[i] += step * d[i];
                d[i] = scale_of(stiffness[i], diagonal) * residual[i] + share * d[i];
                image[i] = fine[i] * d[i];
            }
            lengthen(s, d, span);
        }
    });
}

// The round's x, its last step included, goes into the picture, which stays within 0 and what is brightest.
template <int C>
void end_round(Sharpening& s, float step) {
    in_parallel(s.blur.deep(), [&](int row) {
        const Span span = s.blur.spans[static_cast<size_t>(row)];
        for (int c = 0; c < C; ++c) {
            const float *d = line_of<C>(s, s.d, row).channel[c], *x = line_of<C>(s, s.x, row).channel[c];
            float* fine = line_of<C>(s, s.fine, row).channel[c];
            for (int i = span.begin; i < span.end; ++i) {
                const float value = fine[i] + (x[i] + step * d[i]), above = value > 0 ? value : 0;
                fine[i] = above < BRIGHTEST ? above : BRIGHTEST;
            }
            lengthen(s, fine, span);
        }
    });
}

template <int C>
void improve_all(Sharpening& s, const float* costs, int steps) {
    set_stiffness<C>(s, costs);
    double power = begin_round<C>(s);
    float step = 0;
    for (int n = 1; power > 0; ++n) {
        step = static_cast<float>(power / times<C>(s));
        if (n == steps) break;
        const double before = power;
        power = shrink<C>(s, step);
        turn<C>(s, step, static_cast<float>(power / before));
        step = 0;
    }
    end_round<C>(s, step);
}

// -- what is asked of the picture --------------------------------------------------------------------------

template <int C>
void log_all(const Sharpening& s, float* logarithms) {
    constexpr int AT_ONCE = 256;  // pixels
    const BlurKernels& k = s.blur;
    in_parallel(k.height, [&](int y) {
        const int f = k.fineness;
        for (int left = 0; left < k.width; left += AT_ONCE) {
            const int count = left + AT_ONCE < k.width ? AT_ONCE : k.width - left;
            double products[AT_ONCE];  // of f^2 squares, of which none is under EDGE2
            for (double& product : products) product = 1;
            for (int row = f * y; row < f * (y + 1); ++row) {
                float squares[AT_ONCE * 4];
                for_steepness<C>(s, row, f * left, f * (left + count), 1.0f,
                                 [&](int x, float square) { squares[x - f * left] = square; });
                for (int i = 0; i < f * count; ++i) products[i / f] *= squares[i];
            }
            float* out = logarithms + int64_t{k.width} * y + left;
            for (int i = 0; i < count; ++i) out[i] = static_cast<float>(std::log(products[i]) / (2 * f * f));
        }
    });
}

template <int C>
void blurred_all(Sharpening& s, float* light) {
    const BlurKernels& k = s.blur;
    in_parallel(k.deep(), [&](int row) {
        const Span span = k.spans[static_cast<size_t>(row)];
        const auto fine = line_of<C>(s, s.fine, row), image = line_of<C>(s, s.image, row);
        for (int c = 0; c < C; ++c)
            for (int x = span.begin; x < span.end; ++x) image.channel[c][x] = fine.channel[c][x] * fine.channel[c][x];
    });
    in_parallel(static_cast<int>(k.patches.size()), [&](int patch) {
        const Patch& visits = k.patches[static_cast<size_t>(patch)];
        for (int32_t i = visits.begin; i < visits.end; ++i) {
            const Visit& visit = k.visits[static_cast<size_t>(i)];
            blur_pixel<C>(s, visit, light + int64_t{C} * visit.listed);
        }
    });
}

template <int C>
void light_all(const Sharpening& s, float* light) {
    const BlurKernels& k = s.blur;
    in_parallel(k.height, [&](int y) {
        const int f = k.fineness;
        float* out = light + int64_t{C} * k.width * y;
        for (int i = 0; i < C * k.width; ++i) out[i] = 0;
        for (int row = f * y; row < f * (y + 1); ++row) {
            const auto fine = line_of<C>(s, s.fine, row);
            for (int x = 0; x < k.across(); ++x)
                for (int c = 0; c < C; ++c) {
                    const float value = fine.channel[c][x];
                    out[x / f * C + c] += value * value / static_cast<float>(f * f);
                }
        }
    });
}

// -- for any number of channels ----------------------------------------------------------------------------

void improve(Sharpening& s, const float* costs, int steps) {
    s.channels == 1 ? improve_all<1>(s, costs, steps) : improve_all<3>(s, costs, steps);
}

void log_steepness(const Sharpening& s, float* logarithms) {
    s.channels == 1 ? log_all<1>(s, logarithms) : log_all<3>(s, logarithms);
}

void blurred(Sharpening& s, float* light) { s.channels == 1 ? blurred_all<1>(s, light) : blurred_all<3>(s, light); }

void light(const Sharpening& s, float* light) { s.channels == 1 ? light_all<1>(s, light) : light_all<3>(s, light); }

}  // namespace
}  // namespace omnimirror
