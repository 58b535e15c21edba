// Python interface of batch evaluation, used by omnimirror.optics.batch.evaluate.

#include <nanobind/stl/tuple.h>

#include <tuple>

#include "bindings.hpp"
#include "designs.hpp"

namespace omnimirror {
namespace {

using Search = std::tuple<int, double, double, int, double, int>;  // as in FocusSearch
using LensArguments = std::tuple<double, double, double, double, double, double, double>;  // as in LensTable
using ShellArguments = std::tuple<int, double, double>;  // kind of shell, refractive indices of shell and surroundings

// Limits of lengths, padded to whole lanes, whose products kernels compute as int.
constexpr int64_t MAX_ANGLES = int64_t{1} << 24, MAX_BASIS = int64_t{1} << 28;

LensTable lens_table(const Doubles& values, const LensArguments& numbers) {
    const auto [end, f, f_number, e, pupil, minimum, maximum] = numbers;
    if (values.size() == 0) return {};
    const double* rows = checked(values, "lens", {ANY, 2, LENS_ROWS});
    const int cells = count_of(values.shape(0), "rows of lens", 1 << 24) - 1;
    require(cells > 0, "lens must have at least 2 rows");
    require(end > 0 && minimum < maximum,
            "lens_numbers must contain a field angle above 0 and an increasing focus range");
    return {rows, cells, end, f, f_number, e, pupil, minimum, maximum};
}

void evaluate_designs_binding(const Doubles& coefficients, const Doubles& numbers, const Doubles& basis,
                              const Doubles& fractions, bool has_conic, bool paper, double pitch, double image_radius,
                              double wavelength, const Doubles& inverse_distance, double min_omega,
                              const Search& search, const Doubles& lens, const LensArguments& lens_numbers,
                              const Doubles& shells, const ShellArguments& shell, const DoublesOut& columns,
                              const DoublesOut& results) {
    const double* first_coefficient = checked(coefficients, "coefficients", {ANY, ANY});
    const double* first_fraction = checked(fractions, "fractions", {ANY});
    const int64_t designs = length_of(coefficients, 0), terms = length_of(coefficients, 1), angles = length_of(fractions, 0);
    require(angles > 0, "fractions must not be empty");
    count_of(fractions.shape(0), "angles", MAX_ANGLES);
    count_of(coefficients.shape(1), "terms", MAX_BASIS);
    count_of(static_cast<size_t>(terms * (angles + 8)), "terms times angles", MAX_BASIS);
    const double* first_basis = checked(basis, "basis", {3, terms, angles});
    const double* inverse = checked(inverse_distance, "inverse_distance", {angles});
    const double* first_number = checked(numbers, "numbers", {designs, DESIGN_NUMBERS});
    double* first_column = checked(columns, "columns", {DESIGN_COLUMNS, designs, angles});
    double* first_result = checked(results, "results", {3, designs});
    const auto [scan, margin, tolerance, max_bracket_steps, min_bracket_reduction, bisection_period] = search;
    checked(scan, "scan", 3, MAX_SCAN_SAMPLES);
    checked(bisection_period, "bisection_period", 1, 1 << 30);
    iterations_of(max_bracket_steps, "steps");
    const auto [kind, shell_index, medium_index] = shell;
    checked<int>(kind, "kind of shell", DesignShell::NONE, DesignShell::SPHERE);
    const double* first_shell =
        kind == DesignShell::NONE ? nullptr : checked(shells, "shells", {designs, DESIGN_SHELL_NUMBERS});
    const int64_t part = terms * angles;
    const DesignJob job{first_coefficient,
                        first_number,
                        first_basis,
                        first_basis + part,
                        first_basis + 2 * part,
                        first_fraction,
                        inverse,
                        count_of(coefficients.shape(0), "designs"),
                        static_cast<int>(terms),
                        static_cast<int>(angles),
                        has_conic,
                        paper,
                        pitch,
                        image_radius,
                        wavelength,
                        min_omega,
                        {scan, margin, tolerance, max_bracket_steps, min_bracket_reduction, bisection_period},
                        lens_table(lens, lens_numbers),
                        first_shell,
                        static_cast<DesignShell::Kind>(kind),
                        shell_index,
                        medium_index,
                        first_column,
                        first_result,
                        first_result + designs,
                        first_result + 2 * designs};
    nb::gil_scoped_release released;
    evaluate_designs(job);
}

}  // namespace

void add_designs(nb::module_& m) {
    m.def("evaluate_designs", &evaluate_designs_binding, "coefficients"_a, "numbers"_a, "basis"_a, "fractions"_a,
          "has_conic"_a, "paper"_a, "pitch"_a, "image_radius"_a, "wavelength"_a, "inverse_distance"_a, "min_omega"_a,
          "search"_a, "lens"_a, "lens_numbers"_a, "shells"_a, "shell"_a, "columns"_a, "results"_a);
}

}  // namespace omnimirror
