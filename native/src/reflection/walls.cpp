#include "walls.hpp"

#include "pool.hpp"
#include "wall_optics.hpp"

namespace omnimirror {
namespace {

constexpr long RAYS_A_PIECE = 4096;

Vector<double> of(const double* row) { return {row[0], row[1], row[2]}; }
void put(double* row, Vector<double> v) { row[0] = v.x, row[1] = v.y, row[2] = v.z; }

void leave_one(const WallJob& job, long i) {
    const Vector<double> towards = of(job.directions + 3 * i);
    const double size = std::sqrt(dot(towards, towards));
    const Vector<double> d{towards.x / size, towards.y / size, towards.z / size};
    const WayOut<double> way = way_out(job.wall, of(job.points + 3 * i), d);
    put(job.vectors[0] + 3 * i, way.left_at);
    put(job.vectors[1] + 3 * i, way.outwards);
    put(job.vectors[2] + 3 * i, way.met);
    put(job.vectors[3] + 3 * i, d);
    put(job.vectors[4] + 3 * i, way.inwards);
    job.numbers[0][i] = way.before, job.numbers[1][i] = way.within;
    job.numbers[2][i] = way.cosine_before, job.numbers[3][i] = way.cosine_behind;
    job.meets[i] = way.meets, job.passes[i] = way.passes;
}

}  // namespace

void leave(const WallJob& job) {
    parallel_for(
        static_cast<int>((job.count + RAYS_A_PIECE - 1) / RAYS_A_PIECE),
        [](void* context, int piece) {
            const WallJob& rays = *static_cast<const WallJob*>(context);
            const long first = piece * RAYS_A_PIECE, end = std::min(rays.count, first + RAYS_A_PIECE);
            for (long i = first; i < end; ++i) leave_one(rays, i);
        },
        const_cast<WallJob*>(&job));
}

}  // namespace omnimirror
