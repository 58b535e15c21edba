// The part of omnimirror._native that omnimirror.batch.evaluate calls.

#include <nanobind/stl/tuple.h>

#include <tuple>

#include "bindings.hpp"
#include "designs.hpp"

namespace omnimirror {
namespace {

using Search = std::tuple<int, double, double, int, double, int>;  // as in FocusSearch

void design_batch(const Doubles& coefficients, const Doubles& numbers, const Doubles& basis, const Doubles& fractions,
                  bool has_conic, bool paper, double pitch, double image_radius, double wavelength,
                  const Doubles& inverse_distance, double least_omega, const Search& search, const DoublesOut& columns,
                  const DoublesOut& results) {
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
    require(scan >= 3 && most_steps >= 0 && halving >= 1, "the search scans 3 places at least, and halves at times");
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
          "paper"_a, "pitch"_a, "image_radius"_a, "wavelength"_a, "inverse_distance"_a, "least_omega"_a, "search"_a, "columns"_a,
          "results"_a);
}

}  // namespace omnimirror
