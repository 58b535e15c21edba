#include "exposure.hpp"

#include <algorithm>

#include "pool.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

// Uses the instruction set selected for the samplers, or the plain kernels if there are none for it.
const ExposureKernels& exposure_kernels() {
#if defined(OMNIMIRROR_AVX2)
    if (kernels().level >= Level::AVX2) return avx2_exposure;
#endif
    return plain_exposure;
}

struct LightWork {
    const Exposure& exposure;
    const Environment& world;
    int top;
    float* light;
};

struct RayWork {
    const Exposure& exposure;
    int top;
    RayOut out;
};

// Radiance of a row's rays, summed by pixel, and the rays that reach the background.
class SurfaceRenderer {
  public:
    SurfaceRenderer(const Exposure& e, const SurfaceTree& tree, const OpenRays& open)
        : e_(e), tree_(tree), open_(open), share_(1 / static_cast<float>(e.samples.count)) {}

    void fill(int row, int32_t first_pixel, float* light) {
        RayBlock block;
        std::fill_n(light, int64_t{3} * e_.width, 0.f);
        const int64_t count = int64_t{e_.width} * e_.samples.count;
        for (int64_t first = 0; first < count; first += BLOCK) {
            if (!exposure_kernels().block(e_, row, first, block)) continue;
            for (int k = 0; k < BLOCK / PACKET && first + PACKET * k < count; ++k)
                add(block, k, first + PACKET * k, first_pixel, light);
        }
    }

    int64_t open_count = 0;

  private:
    // Radiance of a packet whose first ray has number `first` in the row.
    void add(const RayBlock& block, int k, int64_t first, int32_t first_pixel, float* light) {
        const Packet& rays = block.packets[k];
        Hits hits;
        packet_kernels().trace(tree_, rays, hits);
        int32_t pixel = static_cast<int32_t>(first / e_.samples.count);
        int left = e_.samples.count - static_cast<int>(first % e_.samples.count);
        for (int i = 0; i < PACKET; ++i) {
            const float weight = share_ * block.weights[PACKET * k + i], fate = block.fates[PACKET * k + i];
            float* sum = light + int64_t{3} * pixel;
            if (rays.limit[i] > 0) {
                for (int c = 0; c < 3; ++c) sum[c] += weight * hits.light[i][c];
                const float clear = hits.surface[i] < 0 ? 1 : hits.light[i][3];
                if (open_.is_requested && clear > 0) add_open_ray(rays, i, first_pixel + pixel, weight * clear);
            } else if (fate == OBSCURED) {
                for (int c = 0; c < 3; ++c) sum[c] += weight * e_.optics.housing_light[c];
            }
            if (!--left) left = e_.samples.count, ++pixel;
        }
    }

    void add_open_ray(const Packet& rays, int i, int32_t pixel, float share) {
        open_.pixels[open_count] = pixel;
        float* out = open_.rays + 7 * open_count++;
        *out++ = share;
        for (int c = 0; c < 3; ++c) *out++ = rays.origin[c][i];
        for (int c = 0; c < 3; ++c) *out++ = rays.direction[c][i];
    }

    const Exposure& e_;
    const SurfaceTree& tree_;
    const OpenRays& open_;
    float share_;
};

}  // namespace

void expose(const Exposure& exposure, const Environment& world, int top, int count, float* light) {
    LightWork work{exposure, world, top, light};
    parallel_for(
        count,
        [](void* context, int i) {
            const auto& w = *static_cast<const LightWork*>(context);
            exposure_kernels().light(w.exposure, w.world, w.top + i, w.light + int64_t{3} * w.exposure.width * i);
        },
        &work);
}

void expose(const Exposure& exposure, int top, int count, const RayOut& out) {
    RayWork work{exposure, top, out};
    parallel_for(
        count,
        [](void* context, int i) {
            const auto& w = *static_cast<const RayWork*>(context);
            const int64_t n = int64_t{w.exposure.width} * w.exposure.samples.count * i;
            exposure_kernels().rays(w.exposure, w.top + i,
                                    {w.out.origins + 3 * n, w.out.directions + 3 * n, w.out.weights + n,
                                     w.out.fates + n});
        },
        &work);
}

int64_t expose(const Exposure& exposure, const SurfaceTree& tree, int top, int count, float* light,
               const OpenRays& open) {
    SurfaceRenderer painter(exposure, tree, open);
    for (int i = 0; i < count; ++i) painter.fill(top + i, i * exposure.width, light + int64_t{3} * exposure.width * i);
    return painter.open_count;
}

}  // namespace omnimirror
