// The part of omnimirror._native that omnimirror.batch.evaluate calls.

#include <nanobind/stl/tuple.h>

#include <tuple>

#include "bindings.hpp"
#include "designs.hpp"

namespace omnimirror {
namespace {

using Search = std::tuple<int, double, double, int, double, int>;  // as in FocusSearch
using LensNumbers = std::tuple<double, double, double, double, double, double, double>;  // as in LensTable
using WallNumbers = std::tuple<int, double, double>;  // which kind, index of the wall and of what is outside

LensTable lens_table(const Doubles& values, const LensNumbers& numbers) {
    const auto [end, f, f_number, e, pupil, least, most] = numbers;
    if (values.size() == 0) return {};
    require(values.ndim() == 3 && values.shape(0) > 1 && values.shape(1) == 2 && values.shape(2) == LENS_ROWS,
            "a lens table is (cells + 1, 2, 27)");
    require(end > 0 && least < most, "a lens has a field, and a range of focus");
    return {values.data(), count_of(values.shape(0)) - 1, end, f, f_number, e, pupil, least, most};
}

void design_batch(const Doubles& coefficients, const Doubles& numbers, const Doubles& basis, const Doubles& fractions,
                  bool has_conic, bool paper, double pitch, double image_radius, double wavelength,
                  const Doubles& inverse_distance, double least_omega, const Search& search, const Doubles& lens,
                  const LensNumbers& lens_numbers, const Doubles& walls, const WallNumbers& wall,
                  const DoublesOut& columns, const DoublesOut& results) {
    require(coefficients.ndim() == 2 && fractions.ndim() == 1, "coefficients are (designs, terms), fractions (angles)");
    const size_t designs = coefficients.shape(0), terms = coefficients.shape(1), angles = fractions.shape(0);
    require(angles > 0, "there must be an angle");
    require(numbers.ndim() == 2 && numbers.shape(0) == designs && numbers.shape(1) == DESIGN_NUMBERS,
            "numbers are (designs, 7)");
    require(inverse_distance.ndim() == 1 && inverse_distance.shape(0) == angles, "inverse distances are (angles)");
    require(basis.ndim() == 3 && basis.shape(0) == 3 && basis.shape(1) == terms && basis.shape(2) == angles,
            "the basis is (3, terms, angles)");
    require(columns.ndim() == 3 && columns.shape(0) == DESIGN_COLUMNS && columns.shape(1) == designs &&
                columns.shape(2) == angles,
            "columns are (10, designs, angles)");
    require(results.ndim() == 2 && results.shape(0) == 3 && results.shape(1) == designs, "results are (3, designs)");
    const auto [scan, margin, close, most_steps, edge, halving] = search;
    require(scan >= 3 && scan <= MOST_SCAN && most_steps >= 0 && halving >= 1,
            "the search scans 3 to 64 places, and halves at times");
    const auto [kind, wall_index, medium_index] = wall;
    require(kind >= Wall::NONE && kind <= Wall::SPHERE, "a wall is none, a plane, a cylinder or a sphere");
    require(kind == Wall::NONE ||
                (walls.ndim() == 2 && walls.shape(0) == designs && walls.shape(1) == WALL_NUMBERS),
            "walls are (designs, 7)");
    const size_t part = terms * angles;
    const DesignJob job{coefficients.data(),
                        numbers.data(),
                        basis.data(),
                        basis.data() + part,
                        basis.data() + 2 * part,
                        fractions.data(),
                        inverse_distance.data(),
                        count_of(designs),
                        count_of(terms),
                        count_of(angles),
                        has_conic,
                        paper,
                        pitch,
                        image_radius,
                        wavelength,
                        least_omega,
                        {scan, margin, close, most_steps, edge, halving},
                        lens_table(lens, lens_numbers),
                        walls.data(),
                        static_cast<Wall::Kind>(kind),
                        wall_index,
                        medium_index,
                        columns.data(),
                        results.data(),
                        results.data() + designs,
                        results.data() + 2 * designs};
    nb::gil_scoped_release released;
    evaluate_designs(job);
}

}  // namespace

void add_designs(nb::module_& m) {
    m.def("evaluate_designs", &design_batch, "coefficients"_a, "numbers"_a, "basis"_a, "fractions"_a, "has_conic"_a,
          "paper"_a, "pitch"_a, "image_radius"_a, "wavelength"_a, "inverse_distance"_a, "least_omega"_a, "search"_a, "lens"_a,
          "lens_numbers"_a, "walls"_a, "wall"_a, "columns"_a, "results"_a);
}

}  // namespace omnimirror
