// Evaluation of one design with an ideal lens, for pages without a server: the kernel of designs.hpp as WebAssembly,
// called by web/src/design/standalone/kernel.ts.
#include "designs/kernel.hpp"

#define OMNIMIRROR_EXPORTED(name) extern "C" __attribute__((export_name(name)))

namespace omnimirror {
namespace {


// Shared buffers of page and kernel: arrays of doubles allocated by room().
struct Arrays {
    const double *coefficients, *numbers, *basis, *fractions, *inverse_distance, *search;
    double *columns, *results;
};

DesignJob job_of(const Arrays& a, int terms, int angles, bool has_conic, double pitch, double wavelength) {
    DesignJob job{};
    job.coefficients = a.coefficients, job.numbers = a.numbers;
    job.sag = a.basis, job.slope = a.basis + terms * angles, job.curvature = a.basis + 2 * terms * angles;
    job.fractions = a.fractions, job.inverse_distance = a.inverse_distance;
    job.designs = 1, job.terms = terms, job.angles = angles, job.has_conic = has_conic;
    job.pitch = pitch, job.wavelength = wavelength;
    job.search = {static_cast<int>(a.search[0]), a.search[1], a.search[2], static_cast<int>(a.search[3]), a.search[4],
                  static_cast<int>(a.search[5])};
    job.columns = a.columns;
    return job;
}

}  // namespace
}  // namespace omnimirror

// Allocate this many doubles, which the page owns.
OMNIMIRROR_EXPORTED("room") double* room(int count) { return new double[count]; }

// Compute the columns (10, angles) of a design, then its sags (angles) in mm, and its scalar results. `focus` is the
// focused distance, from the lens or, if it is telecentric, from the vertex; NaN: at the smallest worst floored area.
OMNIMIRROR_EXPORTED("design")
void design(const double* coefficients, const double* numbers, const double* basis, const double* fractions,
            const double* inverse_distance, const double* search, int terms, int angles, bool has_conic, double pitch,
            double wavelength, double focus, double* columns, double* results) {
    using namespace omnimirror;
    double max_area;
    DesignJob job = job_of({coefficients, numbers, basis, fractions, inverse_distance, search, columns, results}, terms,
                           angles, has_conic, pitch, wavelength);
    job.focus = results, job.max_area = &max_area;
    const Workspace w(job);
    if (has_conic)
        fill_profile<true>(job, 0, w);
    else
        fill_profile<false>(job, 0, w);
    results[1] = trace_ideal_points(job, 0, w);
    if (focus == focus) {
        const Camera camera(job, numbers, w.ray[angles - 1]);
        fill_ideal(camera, camera.telecentric ? -focus : 1 / focus, w);
        results[0] = focus;
    } else {
        focus_ideal(job, 0, w);
    }
    copy_columns(job, 0, w);
    for (int i = 0; i < angles; ++i) columns[DESIGN_COLUMNS * angles + i] = w.z[i] * numbers[1];
}
