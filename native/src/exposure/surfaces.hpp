// Flat textured surfaces, parallelograms and triangles, and the first of them that a ray meets.
//
// Rays go through a tree of boxes in packets: neighbouring rays mostly meet the same boxes, which are then fetched and
// compared once for all. What a ray meets does not depend on the packet that it is in.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

namespace omnimirror {

// A corner and two sides, mm in the world frame; texel coordinates are affine on it. It fills a cache line.
struct alignas(64) Surface {
    float corner[3], side[2][3];
    float texel[2], texel_side[2][2];  // column and row of the corner, and what the sides add
    int32_t kind;  // the texture; of a triangle, the half of the parallelogram that adjoins the corner, -1 minus that

    bool triangle() const { return kind < 0; }
    int32_t texture() const { return kind < 0 ? -1 - kind : kind; }
};
constexpr int SURFACE_FLOATS = sizeof(Surface) / sizeof(float);

// Texels (height, width, 4): red, green, blue, and the share of what is behind that comes through.
struct Texture {
    int64_t first;  // of its texels among all
    int32_t width, height;
    int32_t repeats;  // beyond its edge it starts again; else it has the value of the edge
};

// A box about surfaces.
struct Node {
    float low[3], high[3];
    int32_t first;   // the first of its surfaces, or of its two children
    uint16_t count;  // of its surfaces; 0: it has children
    uint16_t axis;   // along which the first child comes before the second
};

constexpr int DEEPEST = 64;  // levels of the tree, which searches remember

struct SurfaceTree {
    const Node* nodes;  // the root first; none where there are no surfaces
    const Surface* surfaces;
    const Texture* textures;
    const float* texels;
};

constexpr int PACKET = 16;
constexpr float INFINITE = 3e38f;  // farther than any surface

struct alignas(64) Packet {
    float origin[3][PACKET], direction[3][PACKET];
    float limit[PACKET];  // nothing beyond is met, in lengths of the direction; below 0: there is no such ray
};

struct alignas(64) Hits {
    float distance[PACKET];  // in lengths of the direction; the packet's limit where nothing is met
    int32_t surface[PACKET];  // -1 where nothing is met
    float a[PACKET], b[PACKET];  // place on it, in its sides
    float light[PACKET][4];      // and clear share; zero where nothing is met
};

struct PacketKernels {
    void (*see)(const SurfaceTree&, const Packet&, Hits&);
};

extern const PacketKernels plain_packets;
#if defined(OMNIMIRROR_AVX2)
extern const PacketKernels avx2_packets;
#endif
const PacketKernels& packet_kernels();

// A tree of surfaces, which are put into its order; those without width are left out.
std::vector<Node> make_tree(std::vector<Surface>& surfaces);

class Surfaces {
   public:
    // Texels are shared, not copied: of many triangles they are a third of all memory.
    Surfaces(std::vector<Surface> surfaces, std::vector<Texture> textures, std::shared_ptr<const float> texels);

    SurfaceTree tree() const {
        return {nodes_.empty() ? nullptr : nodes_.data(), surfaces_.data(), textures_.data(), texels_.get()};
    }

    // As the tree has ordered them.
    const std::vector<Surface>& surfaces() const { return surfaces_; }

    // For rays (n): light (n, 4) and distances (n), infinite where nothing is met, on the pool.
    void radiance(const float* origins, const float* directions, int64_t count, float* light, float* distances) const;

   private:
    std::vector<Surface> surfaces_;
    std::vector<Texture> textures_;
    std::shared_ptr<const float> texels_;
    std::vector<Node> nodes_;
};

}  // namespace omnimirror
