// Image rows from the rays of kernel.hpp. Compiled in the same way, once per instruction set.
#pragma once

#include "kernel.hpp"

namespace omnimirror {
namespace {

// Positions of directions in the environment image, px: columns in u, rows in v.
void environment_position(const Environment& world, Bundle& r) {
    const float across = static_cast<float>(world.width) / 6.28318531f, middle = 0.5f * static_cast<float>(world.width);
    const float down = static_cast<float>(world.height) / 3.14159265f;
    const float lowest = static_cast<float>(world.height) - 1;
    OMNIMIRROR_EACH_LANE(i) {
        const float x = r.dx[i], y = r.dy[i], z = r.dz[i];
        const float u = middle - across * angle_of(y, x) - 0.5f;
        const float v = down * angle_of(root(x * x + y * y), z) - 0.5f;
        r.u[i] = u < 0 ? u + static_cast<float>(world.width) : u;
        r.v[i] = v < 0 ? 0 : v > lowest ? lowest : v;
    }
}

struct Sum {
    float rgb[4];
};

void add_light(const Environment& world, float u, float v, float weight, Sum& sum) {
    const int column = index_of(u, world.width), above = index_of(v, world.height - 1);
    const int below = above + 1 < world.height ? above + 1 : above;
    const int64_t pitch = 4 * (int64_t{world.width} + 2);
    const float *a = world.texels + above * pitch + 4 * column, *b = world.texels + below * pitch + 4 * column;
    const float fu = u - static_cast<float>(column), fv = weight * (v - static_cast<float>(above));
    const float w10 = fv - fv * fu, w11 = fv * fu, w01 = weight * fu - w11, w00 = weight - w01 - fv;
    for (int c = 0; c < 4; ++c) sum.rgb[c] += w00 * a[c] + w01 * a[c + 4] + w10 * b[c] + w11 * b[c + 4];
}

void light_of_row(const Exposure& e, const Environment& world, int row, float* out) {
    Bundle r;
    const int64_t count = int64_t{e.width} * e.samples.count;
    const float share = 1 / static_cast<float>(e.samples.count);
    Sum sum{};
    int left = e.samples.count;
    for (int64_t first = 0; first < count; first += LANES) {
        const bool any = trace(e, row, first, r);
        if (any) environment_position(world, r);
        const int lanes = count - first < LANES ? static_cast<int>(count - first) : LANES;
        for (int i = 0; i < lanes; ++i) {
            if (any && (r.fate[i] == REFLECTED || r.fate[i] == DIRECT))
                add_light(world, r.u[i], r.v[i], share * r.weight[i], sum);
            else if (any && r.fate[i] == OBSCURED)
                for (int c = 0; c < 3; ++c) sum.rgb[c] += share * r.weight[i] * e.optics.housing_light[c];
            if (--left) continue;
            for (int c = 0; c < 3; ++c) *out++ = sum.rgb[c];
            sum = {}, left = e.samples.count;
        }
    }
}

void rays_of_row(const Exposure& e, int row, const RayOut& out) {
    Bundle r;
    const int64_t count = int64_t{e.width} * e.samples.count;
    const float *m = e.optics.rotation, *shift = e.optics.shift;
    for (int64_t first = 0; first < count; first += LANES) {
        const bool any = trace(e, row, first, r);
        const int lanes = count - first < LANES ? static_cast<int>(count - first) : LANES;
        for (int i = 0; i < lanes; ++i) {
            const int64_t n = first + i;
            const float x = r.px[i], y = r.py[i], z = r.pz[i];
            out.fates[n] = any ? static_cast<uint8_t>(r.fate[i]) : uint8_t{0};
            out.weights[n] = r.weight[i];
            for (int c = 0; c < 3; ++c)
                out.origins[3 * n + c] = m[3 * c] * x + m[3 * c + 1] * y + m[3 * c + 2] * z + shift[c];
            out.directions[3 * n] = r.dx[i], out.directions[3 * n + 1] = r.dy[i], out.directions[3 * n + 2] = r.dz[i];
        }
    }
}

bool rays_of_block(const Exposure& e, int row, int64_t first, RayBlock& out) {
    Bundle r;
    if (!trace(e, row, first, r)) return false;
    const float *m = e.optics.rotation, *shift = e.optics.shift, near = e.optics.distant ? 0.f : 1.f;
    const int64_t left = int64_t{e.width} * e.samples.count - first;
    const int lanes = left < LANES ? static_cast<int>(left) : LANES;
    OMNIMIRROR_EACH_LANE(i) r.fate[i] = i < lanes ? r.fate[i] : LOST;
    for (int k = 0; k < LANES / PACKET; ++k) {
        Packet& p = out.packets[k];
        for (int c = 0; c < 3; ++c)
            for (int j = 0; j < PACKET; ++j) {
                const int i = PACKET * k + j;
                const float position = m[3 * c] * r.px[i] + m[3 * c + 1] * r.py[i] + m[3 * c + 2] * r.pz[i];
                p.origin[c][j] = near * position + shift[c];
            }
        for (int j = 0; j < PACKET; ++j) {
            const int i = PACKET * k + j;
            p.direction[0][j] = r.dx[i], p.direction[1][j] = r.dy[i], p.direction[2][j] = r.dz[i];
            p.limit[j] = (r.fate[i] == REFLECTED) | (r.fate[i] == DIRECT) ? INFINITE : -1;
        }
    }
    OMNIMIRROR_EACH_LANE(i) out.weights[i] = r.weight[i], out.fates[i] = r.fate[i];
    return true;
}

}  // namespace
}  // namespace omnimirror
