// The samplers as omnimirror.dewarp calls them.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>
#include <tuple>
#include <variant>
#include <vector>

#include "axial.hpp"
#include "bindings.hpp"
#include "packed.hpp"
#include "sample.hpp"
#include "sides.hpp"

namespace omnimirror {
namespace {

using In = nb::ndarray<nb::ro, nb::device::cpu>;
using Out = nb::ndarray<nb::device::cpu>;
using Cells = Array<const int32_t, nb::ndim<2>>;
using Taps = Array<const uint8_t, nb::ndim<3>>;
using Border = std::variant<double, std::vector<double>>;  // for all channels, or for each

template <class A>
Depth depth_of(const A& array) {
    if (array.dtype() == nb::dtype<uint8_t>()) return Depth::u8;
    if (array.dtype() == nb::dtype<uint16_t>()) return Depth::u16;
    require(array.dtype() == nb::dtype<float>(), "pictures hold uint8, uint16 or float32");
    return Depth::f32;
}

// (rows, columns, channels) whose pixels adjoin; rows may lie apart, but not overlap.
template <class A>
Picture picture_of(const A& array) {
    require(array.ndim() == 3, "pictures are (height, width, channels)");
    const Depth depth = depth_of(array);
    const int height = count_of(array.shape(0)), width = count_of(array.shape(1)), channels = count_of(array.shape(2));
    require(channels >= 1 && channels <= 4, "pictures have 1 to 4 channels");
    const auto* data = reinterpret_cast<const uint8_t*>(array.data());
    if (array.size() == 0) return {data, width, height, channels, 0, depth};  // its strides mean nothing
    require(is_aligned(data, size_of(depth)), "values must be aligned");
    require(channels == 1 || array.stride(2) == 1, "channels must adjoin");
    require(width <= 1 || array.stride(1) == channels, "pixels must adjoin");
    const int64_t across = int64_t{width} * channels;
    const int64_t row_step = height > 1 ? array.stride(0) : across;
    require(row_step >= across, "rows must follow each other downwards, without overlap");
    return {data, width, height, channels, static_cast<ptrdiff_t>(row_step * size_of(depth)), depth};
}

Picture source_of(const In& array) {
    const Picture picture = picture_of(array);
    require(picture.width > 0 && picture.height > 0, "the picture is empty");
    return picture;
}

Target target_of(const Out& array, const Picture& source) {
    const Picture p = picture_of(array);
    require(p.channels == source.channels && p.depth == source.depth, "dst differs from src in kind");
    return {static_cast<uint8_t*>(array.data()), p.width, p.height, p.stride};
}

Coordinates coordinates_of(const In& array) {
    require(array.ndim() == 3 && array.shape(2) == 2, "coordinates are (height, width, 2)");
    const bool is_double = array.dtype() == nb::dtype<double>();
    require(is_double || array.dtype() == nb::dtype<float>(), "coordinates hold float32 or float64");
    const bool adjoin = array.size() == 0 || (array.stride(2) == 1 && (array.shape(1) == 1 || array.stride(1) == 2));
    require(adjoin, "coordinates must adjoin in a row");
    require(is_aligned(array.data(), is_double ? 8 : 4), "coordinates must be aligned");
    count_of(array.shape(0)), count_of(array.shape(1));
    return {static_cast<const uint8_t*>(array.data()), static_cast<ptrdiff_t>(array.stride(0)) * (is_double ? 8 : 4),
            is_double};
}

Interpolation interpolation_of(int number) {
    require(number >= 0 && number <= 2, "interpolation is 0 (nearest), 1 (linear) or 2 (cubic)");
    return static_cast<Interpolation>(number);
}

template <class T>
void put_border(Job& job, int channel, double value) {
    const T rounded = static_cast<T>(value);
    std::memcpy(job.border + channel * static_cast<int>(sizeof(T)), &rounded, sizeof(T));
}

void put_border(Job& job, const Border& border) {
    const Depth depth = job.source.depth;
    const double most = depth == Depth::u8 ? 255 : 65535;
    const auto* each = std::get_if<std::vector<double>>(&border);
    require(!each || each->size() == static_cast<size_t>(job.source.channels), "the border has one value per channel");
    for (int c = 0; c < job.source.channels; ++c) {
        const double value = each ? (*each)[static_cast<size_t>(c)] : std::get<double>(border);
        require(depth == Depth::f32 || (value >= 0 && value <= most), "the border is no value of the picture's");
        if (depth == Depth::u8) put_border<uint8_t>(job, c, value);
        if (depth == Depth::u16) put_border<uint16_t>(job, c, value);
        if (depth == Depth::f32) put_border<float>(job, c, value);
    }
}

Job job_of(const Sampled& sampled, const Target& target, Interpolation interpolation, const Border& border,
           Where where) {
    Job job{};
    job.source = sampled.source(), job.target = target;
    job.interpolation = interpolation, job.where = where;
    put_border(job, border);
    return job;
}

// How many taps each cell's pixels take: a copy, so that nobody changes it meanwhile.
class Averages {
  public:
    using Ring = std::tuple<double, double, double, double>;  // centre, least and largest distance from it

    Averages(const Taps& taps, int step, double sharp, const std::optional<Ring>& ring)
        : taps_(taps.data(), taps.data() + taps.size()), rows_(taps.shape(0)), columns_(taps.shape(1)), step_(step),
          sharp2_(static_cast<float>(sharp * sharp)), ring_(ring.value_or(Ring{})) {
        require(step == 4 || step == 8 || step == 16 || step == 32 || step == 64, "the step is 4, 8, 16, 32 or 64");
        require(taps.shape(2) == 2, "taps are (cell rows, cell columns, 2)");
        require(std::all_of(taps_.begin(), taps_.end(), [](int count) { return count >= 1 && count <= MOST_TAPS; }),
                "taps are 1 to 128");
    }

    void apply(Job& job) const {
        const auto cells = [&](int pixels) { return static_cast<size_t>((pixels + step_ - 1) / step_); };
        require(rows_ == cells(job.target.height) && columns_ == cells(job.target.width), "taps do not fit dst");
        require(job.interpolation == Interpolation::cubic, "what is averaged are cubic samples");
        require(job.where != Where::nodes || 1 << job.nodes.log2_step == step_, "cells of nodes and taps differ");
        require(job.where != Where::packed || step_ % 8 == 0, "cells of packed maps are multiples of 8");
        const auto [x, y, least, most] = ring_;
        job.footprints = {taps_.data(),          static_cast<int>(columns_), step_,
                          sharp2_,               static_cast<float>(x),      static_cast<float>(y),
                          static_cast<float>(least * least), static_cast<float>(most * most)};
    }

  private:
    std::vector<uint8_t> taps_;
    size_t rows_, columns_;
    int step_;
    float sharp2_;
    Ring ring_;
};

void run(const Job& job) {
    nb::gil_scoped_release released;
    sample(job);
}

void remap(const In& src, const In& coordinates, const Out& dst, int interpolation, const Border& border,
           const Averages* averages) {
    const Picture picture = source_of(src);
    const Interpolation kind = interpolation_of(interpolation);
    const Sampled sampled(picture, kind);
    Job job = job_of(sampled, target_of(dst, picture), kind, border, Where::coordinates);
    job.coordinates = coordinates_of(coordinates);
    require(coordinates.shape(0) == dst.shape(0) && coordinates.shape(1) == dst.shape(1),
            "coordinates and dst differ in size");
    if (averages) averages->apply(job);
    run(job);
}

// Infinite where one is no number.
float largest(const Floats& values) {
    float most = 0;
    for (size_t i = 0; i < values.size(); ++i) {
        const float size = std::fabs(values.data()[i]);
        most = size <= most ? most : std::isnan(size) ? INFINITY : size;
    }
    return most;
}

// A copy that can be read a little beyond its end.
std::vector<float> longer(const Floats& values) {
    std::vector<float> copy(values.size() + BEYOND);
    std::copy_n(values.data(), values.size(), copy.begin());
    return copy;
}

void remap_polar(const In& src, const Floats& radii, const Floats& cosines, const Floats& sines, double x, double y,
                 const Out& dst, int interpolation, const Border& border, const Averages* averages) {
    const Picture picture = source_of(src);
    const Interpolation kind = interpolation_of(interpolation);
    const Sampled sampled(picture, kind);
    Job job = job_of(sampled, target_of(dst, picture), kind, border, Where::polar);
    for (const Floats* floats : {&radii, &cosines, &sines})
        require(is_aligned(floats->data(), 4), "values must be aligned");
    require(radii.size() == dst.shape(0), "there must be one radius per row");
    require(cosines.size() == dst.shape(1) && sines.size() == dst.shape(1), "there must be one direction per column");
    const std::vector<float> all_cosines = longer(cosines), all_sines = longer(sines);
    job.polar = {radii.data(),          all_cosines.data(),    all_sines.data(),
                 static_cast<float>(x), static_cast<float>(y), std::max(largest(cosines), largest(sines))};
    if (averages) averages->apply(job);
    run(job);
}

void check_cells(const Cells& cells, size_t patches) {
    for (size_t i = 0; i < cells.size(); ++i)
        require(cells.data()[i] < static_cast<int64_t>(patches), "a cell names a patch that is not there");
}

void check_lattice(const Floats& x, const Floats& y, size_t step, const Cells& cells, const Floats& patches) {
    require(step == 4 || step == 8 || step == 16 || step == 32 || step == 64, "the step is 4, 8, 16, 32 or 64");
    for (const Floats* floats : {&x, &y, &patches})
        require(is_aligned(floats->data(), 4), "values must be aligned");
    for (const Floats* nodes : {&x, &y})
        require(nodes->ndim() == 2 && nodes->shape(0) == cells.shape(0) + 3 && nodes->shape(1) == cells.shape(1) + 3,
                "there must be three nodes more than cells, down and across");
    require(patches.ndim() == 4 && patches.shape(1) == step && patches.shape(2) == step && patches.shape(3) == 2,
            "patches are (n, step, step, 2)");
    check_cells(cells, patches.shape(0));
}

void find_sides_of_nodes(const Floats& x, const Floats& y, int step, const Cells& cells, const Floats& patches,
                  const Array<float, nb::ndim<3>>& out) {
    check_lattice(x, y, static_cast<size_t>(step), cells, patches);
    require(out.shape(0) == cells.shape(0) && out.shape(1) == cells.shape(1) && out.shape(2) == 2,
            "out is (cell rows, cell columns, 2)");
    squared_sides_of_nodes(x.data(), y.data(), step, cells.data(), count_of(cells.shape(0)), count_of(cells.shape(1)),
                     patches.data(), out.data());
}

void remap_lattice(const In& src, const Floats& x, const Floats& y, const Floats& weights, const Floats& row_weights,
                const Cells& cells, const Floats& patches, const Out& dst, int interpolation, const Border& border,
                const Averages* averages) {
    const Picture picture = source_of(src);
    const Interpolation kind = interpolation_of(interpolation);
    const Sampled sampled(picture, kind);
    Job job = job_of(sampled, target_of(dst, picture), kind, border, Where::nodes);
    require(weights.ndim() == 2 && weights.shape(0) == 4, "weights are (4, step)");
    const size_t step = weights.shape(1);
    require(row_weights.ndim() == 2 && row_weights.shape(0) == 4 && row_weights.shape(1) == step,
            "weights of rows and columns differ in shape");
    for (const Floats* floats : {&weights, &row_weights})
        require(is_aligned(floats->data(), 4), "values must be aligned");
    check_lattice(x, y, step, cells, patches);
    const size_t down = (dst.shape(0) + step - 1) / step, across = (dst.shape(1) + step - 1) / step;
    require(cells.shape(0) == down && cells.shape(1) == across, "cells do not fit dst");
    const std::vector<float> x_nodes = longer(x), y_nodes = longer(y), across_weights = longer(weights);
    job.nodes = {x_nodes.data(),
                 y_nodes.data(),
                 static_cast<int>(down + 3),
                 static_cast<int>(across + 3),
                 std::countr_zero(step),
                 across_weights.data(),
                 row_weights.data(),
                 cells.data(),
                 patches.data(),
                 static_cast<int>(across)};
    const std::vector<int32_t> states = states_of(job.nodes, job.source.geometry);
    job.nodes.cells = states.data();
    if (averages) averages->apply(job);
    run(job);
}

PackedMap* make_packed(const In& coordinates, int width, int height, int channels, bool deep, int interpolation) {
    require(width > 0 && height > 0, "the picture is empty");
    require(channels >= 1 && channels <= 4, "pictures have 1 to 4 channels");
    const Coordinates c = coordinates_of(coordinates);
    const Interpolation kind = interpolation_of(interpolation);
    nb::gil_scoped_release released;
    return new PackedMap(c, static_cast<int>(coordinates.shape(0)), static_cast<int>(coordinates.shape(1)), width,
                         height, channels, deep, kind);
}

// With averages, the coordinates that the map was made of are needed too.
void sample_packed(const PackedMap& map, const In& src, const Out& dst, const Border& border,
                   const std::optional<In>& coordinates, const Averages* averages) {
    const Picture picture = source_of(src);
    require(picture.width == map.width() && picture.height == map.height() && picture.channels == map.channels() &&
                is_deep(picture.depth) == map.deep(),
            "the map was made for another kind of picture");
    const Sampled sampled(picture, map.interpolation());
    Job job = job_of(sampled, target_of(dst, picture), map.interpolation(), border, Where::packed);
    require(job.target.width == map.columns() && job.target.height == map.rows(), "dst has another size than the map");
    if (averages) {
        require(coordinates.has_value(), "averages need coordinates");
        job.coordinates = coordinates_of(*coordinates);
        require(coordinates->shape(0) == dst.shape(0) && coordinates->shape(1) == dst.shape(1),
                "coordinates and dst differ in size");
        averages->apply(job);
    }
    nb::gil_scoped_release released;
    const auto blocks = map.blocks_for(job.source.geometry.row_step);
    job.packed = map.packed(*blocks);
    sample(job);
}

std::vector<double> copy_of(const Doubles& values) {
    for (size_t i = 0; i < values.size(); ++i) require(std::isfinite(values.data()[i]), "tables hold numbers");
    return {values.data(), values.data() + values.size()};
}

AxialCamera* make_axial(const Doubles& frame, double x, double y, int width, int height, double first, double last,
                        const Doubles& radii, const Doubles& origins, double viewpoint) {
    require(frame.ndim() == 2 && frame.shape(0) == 3 && frame.shape(1) == 3, "the frame is (3, 3)");
    require(first < last && last - first < 2, "the table has no length");  // false for NaN
    require(radii.ndim() == 1 && radii.size() >= 2 && radii.size() < (1u << 30), "radii are (n,), n from 2");
    require(origins.ndim() == 2 && origins.shape(1) == 2 && origins.shape(0) != 1 && origins.size() < (1u << 30),
            "origins are (n, 2), n 0 or from 2");
    for (const Doubles* doubles : {&frame, &radii, &origins})
        require(is_aligned(doubles->data(), 8), "values must be aligned");
    Axial camera{};
    for (int i = 0; i < 3; ++i) {
        camera.axis[i] = frame.data()[i];
        camera.right[i] = frame.data()[3 + i];
        camera.down[i] = frame.data()[6 + i];
    }
    camera.x = x, camera.y = y, camera.x_last = width - 1.0, camera.y_last = height - 1.0;
    camera.first = first, camera.last = last, camera.viewpoint = viewpoint;
    return new AxialCamera(camera, copy_of(radii), copy_of(origins));
}

void project_axial(const AxialCamera& camera, const Doubles& targets, bool is_near, const DoublesOut& pixels,
                   std::optional<DoublesOut> excess) {
    require(targets.ndim() == 2 && targets.shape(1) == 3, "targets are (n, 3)");
    const size_t count = targets.shape(0);
    require(count < (size_t{1} << 39), "there are too many targets");
    require(pixels.ndim() == 2 && pixels.shape(0) == count && pixels.shape(1) == 2, "pixels are (n, 2)");
    require(!excess || (excess->ndim() == 1 && excess->shape(0) == count), "the excess is (n,)");
    require(is_aligned(targets.data(), 8) && is_aligned(pixels.data(), 8), "values must be aligned");
    require(!excess || is_aligned(excess->data(), 8), "values must be aligned");
    const Targets all{targets.data(), static_cast<int64_t>(count), is_near, pixels.data(),
                      excess ? excess->data() : nullptr};
    nb::gil_scoped_release released;
    camera.project(all);
}

}  // namespace

void add_sampling(nb::module_& m) {
    nb::class_<Averages>(m, "Averages")
        .def(nb::init<const Taps&, int, double, const std::optional<Averages::Ring>&>(), "taps"_a, "step"_a, "sharp"_a,
             "ring"_a.none());
    m.def("remap", &remap, "src"_a, "coordinates"_a, "dst"_a, "interpolation"_a, "border"_a,
          "averages"_a.none() = nb::none());
    m.def("remap_polar", &remap_polar, "src"_a, "radii"_a, "cosines"_a, "sines"_a, "x"_a, "y"_a, "dst"_a,
          "interpolation"_a, "border"_a, "averages"_a.none() = nb::none());
    m.def("remap_lattice", &remap_lattice, "src"_a, "x"_a, "y"_a, "weights"_a, "row_weights"_a, "cells"_a, "patches"_a,
          "dst"_a, "interpolation"_a, "border"_a, "averages"_a.none() = nb::none());
    m.def("squared_sides_of_nodes", &find_sides_of_nodes, "x"_a, "y"_a, "step"_a, "cells"_a, "patches"_a, "out"_a);
    nb::class_<PackedMap>(m, "PackedMap")
        .def(nb::new_(&make_packed), "coordinates"_a, "width"_a, "height"_a, "channels"_a, "deep"_a, "interpolation"_a)
        .def("sample", &sample_packed, "src"_a, "dst"_a, "border"_a, "coordinates"_a.none() = nb::none(),
             "averages"_a.none() = nb::none())
        .def_prop_ro("nbytes", &PackedMap::bytes);
    nb::class_<AxialCamera>(m, "AxialCamera")
        .def(nb::new_(&make_axial), "frame"_a, "x"_a, "y"_a, "width"_a, "height"_a, "first"_a, "last"_a, "radii"_a,
             "origins"_a, "viewpoint"_a)
        .def("project", &project_axial, "targets"_a, "is_near"_a, "pixels"_a, "excess"_a.none());
    m.def("instructions", [] { return std::string(kernels().name); });
    m.def(
        "use_instructions",
        [](const std::string& name) { require(use_kernels(name.c_str()), "this machine has no such instructions"); },
        "name"_a);
}

}  // namespace omnimirror
