// Flat textured surfaces (parallelograms and triangles), and the first of them that a ray hits.
//
// Rays traverse a bounding volume hierarchy in packets: neighbouring rays mostly hit the same boxes, which are then
// loaded and tested once for all. The result of a ray does not depend on its packet.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

namespace omnimirror {

// A corner and two sides, in mm in the world frame; texel coordinates are affine on the surface. Fills a cache line.
struct alignas(64) Surface {
    float corner[3], side[2][3];
    float texel[2], texel_side[2][2];  // column and row of the corner, and their change along the sides
    int32_t kind;  // texture index; for a triangle (the half of the parallelogram at the corner) -1 minus that

    bool triangle() const { return kind < 0; }
    int32_t texture() const { return kind < 0 ? -1 - kind : kind; }
};
constexpr int SURFACE_FLOATS = sizeof(Surface) / sizeof(float);

// Texels (height, width, 4): red, green, blue, and transparency (fraction of the background).
struct Texture {
    int64_t first;  // index of its first texel in the array of all texels
    int32_t width, height;
    int32_t repeats;  // 1: repeated beyond its edge; 0: clamped to the edge
};

// Bounding box of surfaces.
struct Node {
    float low[3], high[3];
    int32_t first;   // index of its first surface, or of its two children
    uint16_t count;  // number of its surfaces; 0 if it has children
    uint16_t axis;   // along which the first child precedes the second
};

constexpr int MAX_TREE_DEPTH = 64;  // maximum depth of the tree; size of the traversal stack

struct SurfaceTree {
    const Node* nodes;  // the root is first; empty without surfaces
    const Surface* surfaces;
    const Texture* textures;
    const float* texels;
};

constexpr int PACKET = 16;
constexpr float INFINITE = 3e38f;  // larger than any distance to a surface

struct alignas(64) Packet {
    float origin[3][PACKET], direction[3][PACKET];
    float limit[PACKET];  // maximum distance, in lengths of the direction; below 0: no ray
};

struct alignas(64) Hits {
    float distance[PACKET];  // in lengths of the direction; the packet's limit without a hit
    int32_t surface[PACKET];  // -1 without a hit
    float a[PACKET], b[PACKET];  // position on the surface, in units of its sides
    float light[PACKET][4];      // and transparency; 0 without a hit
};

struct PacketKernels {
    void (*trace)(const SurfaceTree&, const Packet&, Hits&);
};

extern const PacketKernels plain_packets;
#if defined(OMNIMIRROR_AVX2)
extern const PacketKernels avx2_packets;
#endif
const PacketKernels& packet_kernels();

// A tree of surfaces. Reorders the surfaces, and drops degenerate ones.
std::vector<Node> make_tree(std::vector<Surface>& surfaces);

class Surfaces {
   public:
    // Texels are shared, not copied: with many triangles, they are a third of all memory.
    Surfaces(std::vector<Surface> surfaces, std::vector<Texture> textures, std::shared_ptr<const float> texels);

    SurfaceTree tree() const {
        return {nodes_.empty() ? nullptr : nodes_.data(), surfaces_.data(), textures_.data(), texels_.get()};
    }

    // In the order of the tree.
    const std::vector<Surface>& surfaces() const { return surfaces_; }

    // Compute, on the thread pool, radiance (n, 4) and distance (n) of rays; the distance is infinite without a hit.
    void radiance(const float* origins, const float* directions, int64_t count, float* light, float* distances) const;

   private:
    std::vector<Surface> surfaces_;
    std::vector<Texture> textures_;
    std::shared_ptr<const float> texels_;
    std::vector<Node> nodes_;
};

}  // namespace omnimirror
