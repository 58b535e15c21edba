// Flat textured surfaces, parallelograms and triangles, and the first of them that a ray meets.
#pragma once

#include <cstdint>
#include <vector>

namespace omnimirror {

// A corner and two sides, mm in the world frame; texel coordinates are affine on it.
struct Surface {
    float corner[3], side[2][3];
    float texel[2], texel_side[2][2];  // column and row of the corner, and what the sides add
    int32_t texture;
    int32_t triangle;  // 1: the half of the parallelogram that adjoins the corner
};

// Texels (height, width, 4): red, green, blue, and the share of what is behind that comes through.
struct Texture {
    int64_t first;  // of its texels among all
    int32_t width, height;
    int32_t repeats;  // beyond its edge it starts again; else it has the value of the edge
};

struct Node {
    float low[3], high[3];
    int32_t first;  // the first of its surfaces, or of its two children
    int32_t count;  // of its surfaces; 0: it has children
};

struct Ray {
    float origin[3], direction[3];
};

struct Hit {
    float distance;  // in lengths of the direction; infinite where nothing is met
    int32_t surface;
    float a, b;  // place on it, in its sides
};

class Surfaces {
   public:
    Surfaces(std::vector<Surface> surfaces, std::vector<Texture> textures, std::vector<float> texels);

    Hit first_hit(const Ray& ray) const;

    // Light and clear share (4) where a ray ends; zero where it meets nothing.
    void look_up(const Hit& hit, float* light) const;

    // For rays (n): light (n, 4) and distances (n), on the pool.
    void radiance(const float* origins, const float* directions, int64_t count, float* light, float* distances) const;

   private:
    void split(int node, std::vector<int>& order, const std::vector<Node>& boxes);

    std::vector<Surface> surfaces_;
    std::vector<Texture> textures_;
    std::vector<float> texels_;
    std::vector<Node> nodes_;
};

}  // namespace omnimirror
