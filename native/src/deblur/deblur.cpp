#include "deblur.hpp"

#include <algorithm>
#include <utility>

#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr int64_t PLACES_AT_ONCE = 1 << 14;  // so that sums do not depend on the number of threads

template <class F>
void in_parallel(int count, F f) {
    parallel_for(count, [](void* context, int i) { (*static_cast<F*>(context))(i); }, &f);
}

template <class F>
double sum_in_parallel(int64_t places, F f) {
    const int count = static_cast<int>((places + PLACES_AT_ONCE - 1) / PLACES_AT_ONCE);
    std::vector<double> sums(static_cast<size_t>(count));
    in_parallel(count, [&](int i) {
        const int64_t begin = PLACES_AT_ONCE * i;
        sums[static_cast<size_t>(i)] = f(begin, std::min(begin + PLACES_AT_ONCE, places));
    });
    double sum = 0;
    for (const double part : sums) sum += part;
    return sum;
}

// Calls f(place on the fine grid, weights, count) for the runs of a pixel; what would lie outside the picture is
// taken from its edge, one by one.
template <class F>
void for_runs(const BlurKernels& k, int64_t i, F f) {
    const int pixel = k.pixels[static_cast<size_t>(i)], kernel = k.kernels[static_cast<size_t>(i)];
    const int across = k.width * k.fineness, deep = k.height * k.fineness;
    const int y = pixel / k.width * k.fineness, x = pixel % k.width * k.fineness;
    const bool inside = y + k.least_down >= 0 && y + k.most_down < deep && x + k.least_right >= 0 &&
                        x + k.most_right < across;
    const Run* const end = k.runs.data() + k.first_runs[static_cast<size_t>(kernel) + 1];
    for (const Run* run = k.runs.data() + k.first_runs[static_cast<size_t>(kernel)]; run < end; ++run) {
        const float* weights = k.weights.data() + run->weight;
        if (inside) {
            f(int64_t{y + run->down} * across + x + run->right, weights, run->count);
            continue;
        }
        const int64_t row = int64_t{std::clamp(y + run->down, 0, deep - 1)} * across;
        for (int j = 0; j < run->count; ++j) f(row + std::clamp(x + run->right + j, 0, across - 1), weights + j, 1);
    }
}

// b_i = sum_j A_ij f_j of one pixel i: f the fine values, A its kernel.
template <int C>
void blur_pixel(const BlurKernels& k, int64_t i, const float* fine, float* blurred) {
    float sums[4 * C] = {};  // of every fourth value, so that none waits for the last
    for_runs(k, i, [&](int64_t place, const float* weights, int count) {
        const float* values = fine + C * place;
        int j = 0;
        for (; j + 4 <= count; j += 4)
            for (int n = 0; n < 4; ++n)
                for (int c = 0; c < C; ++c) sums[C * n + c] += weights[j + n] * values[C * (j + n) + c];
        for (; j < count; ++j)
            for (int c = 0; c < C; ++c) sums[C * (j & 3) + c] += weights[j] * values[C * j + c];
    });
    for (int c = 0; c < C; ++c) blurred[C * i + c] = (sums[c] + sums[C + c]) + (sums[2 * C + c] + sums[3 * C + c]);
}

// f_j += A_ij b_i of one pixel i, the transpose.
template <int C>
void spread_pixel(const BlurKernels& k, int64_t i, const float* blurred, float* fine) {
    float value[C];
    std::copy_n(blurred + C * i, C, value);
    for_runs(k, i, [&](int64_t place, const float* weights, int count) {
        float* values = fine + C * place;
        for (int j = 0; j < count; ++j)
            for (int c = 0; c < C; ++c) values[C * j + c] += weights[j] * value[c];
    });
}

// The pixels of rows [top, top + count) as [begin, end) in the list.
std::pair<int64_t, int64_t> pixels_of_rows(const BlurKernels& k, int64_t top, int64_t count) {
    const auto at = [&](int64_t row) {
        const auto first = static_cast<int32_t>(std::min<int64_t>(row, k.height) * k.width);
        return std::lower_bound(k.pixels.begin(), k.pixels.end(), first) - k.pixels.begin();
    };
    return {at(top), at(top + count)};
}

template <int C>
void blur_all(const BlurKernels& k, const float* fine, float* blurred, const float* factor) {
    in_parallel(k.height, [&](int row) {
        const auto [begin, end] = pixels_of_rows(k, row, 1);
        for (int64_t i = begin; i < end; ++i) {
            blur_pixel<C>(k, i, fine, blurred);
            if (factor)
                for (int c = 0; c < C; ++c) blurred[C * i + c] *= factor[C * i + c];
        }
    });
}

// Every second band of rows at a time: these do not touch each other's values, and the order of sums is fixed.
template <int C>
void spread_all(const BlurKernels& k, const float* blurred, float* fine) {
    const int across = k.width * k.fineness, deep = k.height * k.fineness;
    in_parallel(deep, [&](int row) { std::fill_n(fine + int64_t{C} * across * row, int64_t{C} * across, 0.0f); });
    const int reach = std::max(k.most_down, -k.least_down);
    const int rows = std::max(16, 2 * reach / k.fineness + 2), bands = (k.height + rows - 1) / rows;
    for (int odd = 0; odd < 2; ++odd)
        in_parallel((bands + 1 - odd) / 2, [&](int i) {
            const auto [begin, end] = pixels_of_rows(k, int64_t{rows} * (2 * i + odd), rows);
            for (int64_t pixel = begin; pixel < end; ++pixel) spread_pixel<C>(k, pixel, blurred, fine);
        });
}

// product = fine product + the smoothness of d, in one row of the fine grid; returns its scalar product with d.
template <int C>
double smoothness_of_row(const Curvature& q, int row, const float* d, float* product) {
    const int across = q.kernels.width * q.kernels.fineness, deep = q.kernels.height * q.kernels.fineness;
    const int64_t line = int64_t{C} * across;
    const float *here = d + line * row, *stiffness = q.stiffness + int64_t{across} * row, *fine = q.fine + line * row;
    // beyond the picture its values go on, and differences vanish
    const float *above = row > 0 ? here - line : here, *below = row + 1 < deep ? here + line : here;
    const float* stiffness_above = row > 0 ? stiffness - across : stiffness;
    float* out = product + line * row;
    float sums[C] = {};
    const auto place = [&](int x, int left, int right) {
        const float s = stiffness[x], of_left = stiffness[x - left], of_above = stiffness_above[x];
        for (int c = 0; c < C; ++c) {
            const int i = C * x + c;
            const float smooth = of_left * (here[i] - here[i - C * left]) + s * (here[i] - here[i + C * right]) +
                                 of_above * (here[i] - above[i]) + s * (here[i] - below[i]);
            out[i] = fine[i] * out[i] + smooth;
            sums[c] += out[i] * here[i];
        }
    };
    place(0, 0, across > 1);
    for (int x = 1; x + 1 < across; ++x) place(x, 1, 1);
    if (across > 1) place(across - 1, 1, 0);
    double sum = 0;
    for (const float part : sums) sum += part;
    return sum;
}

template <int C>
double times_all(const Curvature& q, const float* d, float* product, float* scratch) {
    const BlurKernels& k = q.kernels;
    const int64_t line = int64_t{C} * k.width * k.fineness;
    const int deep = k.height * k.fineness;
    in_parallel(deep, [&](int row) {
        for (int64_t i = line * row; i < line * (row + 1); ++i) product[i] = q.fine[i] * d[i];
    });
    blur_all<C>(k, product, scratch, q.slope2);
    spread_all<C>(k, scratch, product);
    std::vector<double> sums(static_cast<size_t>(deep));
    in_parallel(deep, [&](int row) { sums[static_cast<size_t>(row)] = smoothness_of_row<C>(q, row, d, product); });
    double sum = 0;
    for (const double part : sums) sum += part;
    return sum;
}

template <int C>
double advance_all(int64_t places, float step, const float* d, const float* product, const float* scale, float* x,
                   float* residual) {
    return sum_in_parallel(places, [&](int64_t begin, int64_t end) {
        double sum = 0;
        for (int64_t p = begin; p < end; ++p) {
            float power = 0;
            for (int64_t i = C * p; i < C * (p + 1); ++i) {
                x[i] += step * d[i];
                residual[i] -= step * product[i];
                power += residual[i] * residual[i];
            }
            sum += power * scale[p];
        }
        return sum;
    });
}

template <int C>
void turn_all(int64_t places, float share, const float* scale, const float* residual, float* d) {
    sum_in_parallel(places, [&](int64_t begin, int64_t end) {
        for (int64_t p = begin; p < end; ++p)
            for (int64_t i = C * p; i < C * (p + 1); ++i) d[i] = scale[p] * residual[i] + share * d[i];
        return 0.0;
    });
}

}  // namespace

void blur(const BlurKernels& kernels, int channels, const float* fine, float* blurred) {
    channels == 1 ? blur_all<1>(kernels, fine, blurred, nullptr) : blur_all<4>(kernels, fine, blurred, nullptr);
}

void spread(const BlurKernels& kernels, int channels, const float* blurred, float* fine) {
    channels == 1 ? spread_all<1>(kernels, blurred, fine) : spread_all<4>(kernels, blurred, fine);
}

double times(const Curvature& curvature, const float* d, float* product, float* scratch) {
    return curvature.channels == 1 ? times_all<1>(curvature, d, product, scratch)
                                   : times_all<4>(curvature, d, product, scratch);
}

double advance(int64_t places, int channels, float step, const float* d, const float* product, const float* scale,
               float* x, float* residual) {
    return channels == 1 ? advance_all<1>(places, step, d, product, scale, x, residual)
                         : advance_all<4>(places, step, d, product, scale, x, residual);
}

void turn(int64_t places, int channels, float share, const float* scale, const float* residual, float* d) {
    channels == 1 ? turn_all<1>(places, share, scale, residual, d) : turn_all<4>(places, share, scale, residual, d);
}

}  // namespace omnimirror
