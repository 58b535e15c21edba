#include "walls.hpp"

#include "pieces.hpp"
#include "wall_optics.hpp"

namespace omnimirror {
namespace {

constexpr int RAYS_A_PIECE = 4096;

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

void leave_some(const WallJob& job, long first, int count) {
    for (long i = first; i < first + count; ++i) leave_one(job, i);
}

}  // namespace

void leave(const WallJob& job) { in_pieces(job, RAYS_A_PIECE, leave_some); }

}  // namespace omnimirror
