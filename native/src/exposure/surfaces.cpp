#include "surfaces.hpp"

#include <algorithm>
#include <limits>

#include "pool.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int64_t RAYS_PER_TASK = 4096;  // rays per task

struct Work {
    SurfaceTree tree;
    const float *origins, *directions;
    int64_t count;
    float *light, *distances;
};

// Rays from number `first` on; excess rays are marked as absent.
Packet packet_of(const Work& w, int64_t first) {
    Packet packet;
    for (int i = 0; i < PACKET; ++i) {
        const int64_t ray = std::min(first + i, w.count - 1);
        for (int c = 0; c < 3; ++c) {
            packet.origin[c][i] = w.origins[3 * ray + c];
            packet.direction[c][i] = w.directions[3 * ray + c];
        }
        packet.limit[i] = first + i < w.count ? INFINITE : -1;
    }
    return packet;
}

void radiance_task(void* context, int portion) {
    const Work& w = *static_cast<const Work*>(context);
    const PacketKernels& kernels = packet_kernels();
    const int64_t end = std::min(w.count, RAYS_PER_TASK * (portion + int64_t{1}));
    Hits hits;
    for (int64_t first = RAYS_PER_TASK * portion; first < end; first += PACKET) {
        kernels.trace(w.tree, packet_of(w, first), hits);
        const int count = static_cast<int>(std::min<int64_t>(PACKET, end - first));
        std::copy_n(&hits.light[0][0], 4 * count, w.light + 4 * first);
        for (int i = 0; i < count; ++i)
            w.distances[first + i] =
                hits.surface[i] < 0 ? std::numeric_limits<float>::infinity() : hits.distance[i];
    }
}

}  // namespace

// Uses the instruction set selected for the samplers, or the plain kernels if there are none for it.
const PacketKernels& packet_kernels() {
#if defined(OMNIMIRROR_AVX2)
    if (kernels().level >= Level::AVX2) return avx2_packets;
#endif
    return plain_packets;
}

Surfaces::Surfaces(std::vector<Surface> surfaces, std::vector<Texture> textures, std::shared_ptr<const float> texels)
    : surfaces_(std::move(surfaces)),
      textures_(std::move(textures)),
      texels_(std::move(texels)),
      nodes_(make_tree(surfaces_)) {}

void Surfaces::radiance(const float* origins, const float* directions, int64_t count, float* light,
                        float* distances) const {
    Work work{tree(), origins, directions, count, light, distances};
    parallel_for(static_cast<int>((count + RAYS_PER_TASK - 1) / RAYS_PER_TASK), &radiance_task, &work);
}

}  // namespace omnimirror
