// Python interface of the samplers, used by omnimirror.dewarp.
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
#include "footprint_sides.hpp"
#include "packed.hpp"
#include "sample.hpp"

namespace omnimirror {
namespace {

using In = nb::ndarray<nb::ro, nb::device::cpu>;
using Out = nb::ndarray<nb::device::cpu>;
using Cells = Array<const int32_t, nb::ndim<2>>;
using Taps = Array<const uint8_t, nb::ndim<3>>;
using Border = std::variant<double, std::vector<double>>;  // for all channels, or one per channel

template <class A>
Depth depth_of(const A& array) {
    if (array.dtype() == nb::dtype<uint8_t>()) return Depth::u8;
    if (array.dtype() == nb::dtype<uint16_t>()) return Depth::u16;
    require(array.dtype() == nb::dtype<float>(), "images must be uint8, uint16 or float32");
    return Depth::f32;
}

// (rows, columns, channels) with contiguous pixels; rows may have gaps, but must not overlap.
template <class A>
Image image_of(const A& array, const char* name) {
    const auto* data = reinterpret_cast<const uint8_t*>(checked(array, name, {ANY, ANY, ANY}));
    const Depth depth = depth_of(array);
    const int height = count_of(array.shape(0), "height"), width = count_of(array.shape(1), "width");
    const int channels = count_of(array.shape(2), "channels", 4);
    require(channels >= 1, "images must have 1 to 4 channels");
    if (array.size() == 0) return {data, width, height, channels, 0, depth};  // strides of empty arrays are arbitrary
    require(channels == 1 || array.stride(2) == 1, "the channels of an image must be contiguous");
    require(width <= 1 || array.stride(1) == channels, "the pixels of an image row must be contiguous");
    const int64_t across = int64_t{width} * channels;
    const int64_t row_step = height > 1 ? array.stride(0) : across;
    checked<int64_t>(row_step, "stride of rows", across, MAX_LENGTH);  // increasing, without overlap
    return {data, width, height, channels, static_cast<ptrdiff_t>(row_step * size_of(depth)), depth};
}

Image source_of(const In& array) {
    const Image image = image_of(array, "src");
    require(image.width > 0 && image.height > 0, "src must not be empty");
    return image;
}

Target target_of(const Out& array, const Image& source) {
    const Image p = image_of(array, "dst");
    require(p.channels == source.channels && p.depth == source.depth,
            "dst must have the data type and the channels of src");
    return {static_cast<uint8_t*>(array.data()), p.width, p.height, p.stride};
}

// (rows, columns, 2), with arbitrary row strides.
Coordinates coordinates_of(const In& array, int64_t rows = ANY, int64_t columns = ANY) {
    const auto* data = static_cast<const uint8_t*>(checked(array, "coordinates", {rows, columns, 2}));
    const bool is_double = array.dtype() == nb::dtype<double>();
    require(is_double || array.dtype() == nb::dtype<float>(), "coordinates must be float32 or float64");
    const bool adjoin = array.size() == 0 || (array.stride(2) == 1 && (array.shape(1) == 1 || array.stride(1) == 2));
    require(adjoin, "the coordinates of a row must be contiguous");
    count_of(array.shape(0), "rows of coordinates"), count_of(array.shape(1), "columns of coordinates");
    return {data, static_cast<ptrdiff_t>(array.stride(0)) * (is_double ? 8 : 4), is_double};
}

Interpolation interpolation_of(int number) {
    return static_cast<Interpolation>(checked(number, "interpolation", 0, 2));  // nearest, linear, cubic
}

template <class T>
void set_border(Job& job, int channel, double value) {
    const T rounded = static_cast<T>(value);
    std::memcpy(job.border + channel * static_cast<int>(sizeof(T)), &rounded, sizeof(T));
}

void set_border(Job& job, const Border& border) {
    const Depth depth = job.source.depth;
    const double maximum = depth == Depth::u8 ? 255 : 65535;
    const auto* each = std::get_if<std::vector<double>>(&border);
    require(!each || each->size() == static_cast<size_t>(job.source.channels), "border must have one value per channel");
    for (int c = 0; c < job.source.channels; ++c) {
        const double value = each ? (*each)[static_cast<size_t>(c)] : std::get<double>(border);
        if (depth != Depth::f32) checked(value, "border", 0.0, maximum);
        if (depth == Depth::u8) set_border<uint8_t>(job, c, value);
        if (depth == Depth::u16) set_border<uint16_t>(job, c, value);
        if (depth == Depth::f32) set_border<float>(job, c, value);
    }
}

Job job_of(const SourceImage& source_image, const Target& target, Interpolation interpolation, const Border& border,
           MapType map_type) {
    Job job{};
    job.source = source_image.source(), job.target = target;
    job.interpolation = interpolation, job.map_type = map_type;
    set_border(job, border);
    return job;
}

int step_of(int64_t step) {
    require(step == 4 || step == 8 || step == 16 || step == 32 || step == 64, "step must be 4, 8, 16, 32 or 64");
    return static_cast<int>(step);
}

// Tap counts of each cell; copied, so that they cannot change after the check.
class Averages {
  public:
    using Annulus = std::tuple<double, double, double, double>;  // centre, minimum and maximum distance from it

    Averages(const Taps& taps, int step, double sharp_px, const std::optional<Annulus>& annulus)
        : step_(step_of(step)),
          sharp2_px2_(static_cast<float>(sharp_px * sharp_px)),
          annulus_(annulus.value_or(Annulus{})) {
        const uint8_t* first = checked(taps, "taps", {ANY, ANY, 2});
        taps_.assign(first, first + taps.size()), rows_ = taps.shape(0), columns_ = taps.shape(1);
        for (const int count : taps_) checked(count, "taps", 1, MAX_TAPS);
    }

    void apply(Job& job) const {
        const auto cells = [&](int pixels) { return static_cast<size_t>((pixels + step_ - 1) / step_); };
        require(rows_ == cells(job.target.height) && columns_ == cells(job.target.width),
                "taps must have one entry per cell of dst");
        require(job.interpolation == Interpolation::cubic, "interpolation must be 2 (cubic) if averages are given");
        require(job.map_type != MapType::lattice || 1 << job.lattice.log2_step == step_,
                "averages must have the step of the lattice");
        require(job.map_type != MapType::packed || step_ % 8 == 0, "step must be a multiple of 8 for packed maps");
        const auto [x, y, minimum, maximum] = annulus_;
        job.footprints = {taps_.data(),
                          static_cast<int>(columns_),
                          step_,
                          sharp2_px2_,
                          static_cast<float>(x),
                          static_cast<float>(y),
                          static_cast<float>(minimum * minimum),
                          static_cast<float>(maximum * maximum)};
    }

  private:
    std::vector<uint8_t> taps_;
    size_t rows_ = 0, columns_ = 0;
    int step_;
    float sharp2_px2_;
    Annulus annulus_;
};

void run(const Job& job) {
    nb::gil_scoped_release released;
    sample(job);
}

void remap(const In& src, const In& coordinates, const Out& dst, int interpolation, const Border& border,
           const Averages* averages) {
    const Image image = source_of(src);
    const Interpolation kind = interpolation_of(interpolation);
    const SourceImage source_image(image, kind);
    Job job = job_of(source_image, target_of(dst, image), kind, border, MapType::coordinates);
    job.coordinates = coordinates_of(coordinates, job.target.height, job.target.width);
    if (averages) averages->apply(job);
    run(job);
}

// Return the largest absolute value; infinite if any value is NaN.
float max_magnitude(const std::vector<float>& values) {
    float maximum = 0;
    for (const float value : values) {
        const float size = std::fabs(value);
        maximum = size <= maximum ? maximum : std::isnan(size) ? INFINITY : size;
    }
    return maximum;
}

// Copy with PADDING readable values after the end; it cannot change between its check and its use.
std::vector<float> padded_copy(const float* values, size_t count) {
    std::vector<float> copy(count + PADDING);
    std::copy_n(values, count, copy.begin());
    return copy;
}

std::vector<float> padded_copy(const Floats& values) { return padded_copy(values.data(), values.size()); }

void remap_polar(const In& src, const Floats& radii, const Floats& cosines, const Floats& sines, double x, double y,
                 const Out& dst, int interpolation, const Border& border, const Averages* averages) {
    const Image image = source_of(src);
    const Interpolation kind = interpolation_of(interpolation);
    const SourceImage source_image(image, kind);
    Job job = job_of(source_image, target_of(dst, image), kind, border, MapType::polar);
    checked(radii, "radii", {job.target.height});
    checked(cosines, "cosines", {job.target.width}), checked(sines, "sines", {job.target.width});
    const std::vector<float> all_radii = padded_copy(radii), all_cosines = padded_copy(cosines),
                             all_sines = padded_copy(sines);
    job.polar = {all_radii.data(),      all_cosines.data(),
                 all_sines.data(),      static_cast<float>(x),
                 static_cast<float>(y), std::max(max_magnitude(all_cosines), max_magnitude(all_sines))};
    if (averages) averages->apply(job);
    run(job);
}

// Return a checked copy of the cells.
std::vector<int32_t> cells_of(const Cells& cells, int64_t patches) {
    const int32_t* first = checked(cells, "cells", {ANY, ANY});
    const std::vector<int32_t> copy(first, first + cells.size());
    for (const int32_t cell : copy) require(cell < patches, "cells must be less than the number of patches");
    return copy;
}

// The lattice has three more nodes than cells in each direction; nodes may be NaN where the lattice ends.
std::vector<int32_t> checked_lattice(const Floats& x, const Floats& y, int step, const Cells& cells,
                                     const Floats& patches) {
    const int64_t rows = length_of(cells, 0), columns = length_of(cells, 1);
    count_of(cells.shape(0), "rows of cells"), count_of(cells.shape(1), "columns of cells");
    checked(x, "x", {rows + 3, columns + 3}), checked(y, "y", {rows + 3, columns + 3});
    checked(patches, "patches", {ANY, step, step, 2});
    return cells_of(cells, length_of(patches, 0));
}

void lattice_sides_binding(const Floats& x, const Floats& y, int step, const Cells& cells, const Floats& patches,
                           const FloatsOut& out) {
    const std::vector<int32_t> which = checked_lattice(x, y, step_of(step), cells, patches);
    float* sides = checked(out, "out", {length_of(cells, 0), length_of(cells, 1), 2});
    squared_sides_of_lattice(x.data(), y.data(), step, which.data(), static_cast<int>(cells.shape(0)),
                             static_cast<int>(cells.shape(1)), patches.data(), sides);
}

// Return the largest sum of the absolute values of a pixel's weights. The weights themselves must sum to 1, which
// interpolation requires.
float reach_of(const std::vector<float>& weights, int step) {
    float reach = 0;
    for (int i = 0; i < step; ++i) {
        float sum = 0, size = 0;
        for (int k = 0; k < 4; ++k) sum += weights[k * step + i], size += std::fabs(weights[k * step + i]);
        require(std::fabs(sum - 1) <= 1e-5f, "the weights of each pixel must sum to 1");
        reach = std::max(reach, size);
    }
    return reach;
}

void remap_lattice(const In& src, const Floats& x, const Floats& y, const Floats& weights, const Floats& row_weights,
                   const Cells& cells, const Floats& patches, const Out& dst, int interpolation, const Border& border,
                   const Averages* averages) {
    const Image image = source_of(src);
    const Interpolation kind = interpolation_of(interpolation);
    const SourceImage source_image(image, kind);
    Job job = job_of(source_image, target_of(dst, image), kind, border, MapType::lattice);
    const int step = step_of(length_of(weights, 1));
    checked(weights, "weights", {4, step}, Values::finite);
    checked(row_weights, "row_weights", {4, step}, Values::finite);
    const std::vector<int32_t> checked_cells = checked_lattice(x, y, step, cells, patches);
    const int64_t down = (int64_t{job.target.height} + step - 1) / step;
    const int64_t across = (int64_t{job.target.width} + step - 1) / step;
    checked(cells, "cells", {down, across});
    const std::vector<float> x_nodes = padded_copy(x), y_nodes = padded_copy(y);
    const std::vector<float> across_weights = padded_copy(weights), down_weights = padded_copy(row_weights);
    job.lattice = {x_nodes.data(),
                   y_nodes.data(),
                   static_cast<int>(down + 3),
                   static_cast<int>(across + 3),
                   std::countr_zero(static_cast<unsigned>(step)),
                   across_weights.data(),
                   down_weights.data(),
                   checked_cells.data(),
                   patches.data(),
                   static_cast<int>(across)};
    const float reach = reach_of(across_weights, step) * reach_of(down_weights, step);
    const std::vector<int32_t> states = states_of(job.lattice, job.source.geometry, reach);
    job.lattice.cells = states.data();
    if (averages) averages->apply(job);
    run(job);
}

PackedMap* make_packed(const In& coordinates, int width, int height, int channels, bool is_deep, int interpolation) {
    checked<int64_t>(width, "width", 1, MAX_COUNT), checked<int64_t>(height, "height", 1, MAX_COUNT);
    checked(channels, "channels", 1, 4);
    const Coordinates c = coordinates_of(coordinates);
    const Interpolation kind = interpolation_of(interpolation);
    nb::gil_scoped_release released;
    return new PackedMap(c, static_cast<int>(coordinates.shape(0)), static_cast<int>(coordinates.shape(1)), width,
                         height, channels, is_deep, kind);
}

// Averages also require the coordinates from which the map was built.
void sample_packed(const PackedMap& map, const In& src, const Out& dst, const Border& border,
                   const std::optional<In>& coordinates, const Averages* averages) {
    const Image image = source_of(src);
    require(image.width == map.width() && image.height == map.height() && image.channels == map.channels() &&
                is_deep(image.depth) == map.is_deep(),
            "src must have the size, channels and bit depth of the packed map");
    const SourceImage source_image(image, map.interpolation());
    Job job = job_of(source_image, target_of(dst, image), map.interpolation(), border, MapType::packed);
    require(job.target.width == map.columns() && job.target.height == map.rows(),
            "dst must have the size of the packed map");
    if (averages) {
        require(coordinates.has_value(), "coordinates are required if averages are given");
        job.coordinates = coordinates_of(*coordinates, job.target.height, job.target.width);
        averages->apply(job);
    }
    nb::gil_scoped_release released;
    const auto blocks = map.blocks_for(job.source.geometry.row_step);
    job.packed = map.packed(*blocks);
    sample(job);
}

AxialCamera* make_axial(const Doubles& frame, double x, double y, int width, int height, double first, double last,
                        const Doubles& radii, const Doubles& origins, double viewpoint) {
    const double* axes = checked(frame, "frame", {3, 3}, Values::finite);
    require(first < last && last - first < 2, "last must be between first and first + 2");
    const double* radius = checked(radii, "radii", {ANY}, Values::finite);
    const double* origin = checked(origins, "origins", {ANY, 2}, Values::finite);
    const int entries = count_of(radii.shape(0), "radii"), starts = count_of(origins.shape(0), "origins");
    require(entries >= 2 && starts != 1, "radii must have at least 2 values, and origins 0 or at least 2 rows");
    Axial camera{};
    for (int i = 0; i < 3; ++i) camera.axis[i] = axes[i], camera.right[i] = axes[3 + i], camera.down[i] = axes[6 + i];
    camera.x = x, camera.y = y, camera.x_last = width - 1.0, camera.y_last = height - 1.0;
    camera.first = first, camera.last = last, camera.viewpoint = viewpoint;
    return new AxialCamera(camera, {radius, radius + entries}, {origin, origin + 2 * int64_t{starts}});
}

void project_axial(const AxialCamera& camera, const Doubles& targets, bool is_near, const DoublesOut& pixels,
                   std::optional<DoublesOut> excess) {
    const double* xyz = checked(targets, "targets", {ANY, 3});
    const int64_t count = length_of(targets, 0);
    checked<int64_t>(count, "targets", 0, int64_t{1} << 38);
    const Targets all{xyz, count, is_near, checked(pixels, "pixels", {count, 2}),
                      excess ? checked(*excess, "excess", {count}) : nullptr};
    nb::gil_scoped_release released;
    camera.project(all);
}

}  // namespace

void add_sampling(nb::module_& m) {
    nb::class_<Averages>(m, "Averages")
        .def(nb::init<const Taps&, int, double, const std::optional<Averages::Annulus>&>(), "taps"_a, "step"_a,
             "sharp_px"_a, "annulus"_a.none());
    m.def("remap", &remap, "src"_a, "coordinates"_a, "dst"_a, "interpolation"_a, "border"_a,
          "averages"_a.none() = nb::none());
    m.def("remap_polar", &remap_polar, "src"_a, "radii"_a, "cosines"_a, "sines"_a, "x"_a, "y"_a, "dst"_a,
          "interpolation"_a, "border"_a, "averages"_a.none() = nb::none());
    m.def("remap_lattice", &remap_lattice, "src"_a, "x"_a, "y"_a, "weights"_a, "row_weights"_a, "cells"_a, "patches"_a,
          "dst"_a, "interpolation"_a, "border"_a, "averages"_a.none() = nb::none());
    m.def("squared_sides_of_lattice", &lattice_sides_binding, "x"_a, "y"_a, "step"_a, "cells"_a, "patches"_a, "out"_a);
    nb::class_<PackedMap>(m, "PackedMap")
        .def(nb::new_(&make_packed), "coordinates"_a, "width"_a, "height"_a, "channels"_a, "is_deep"_a,
             "interpolation"_a)
        .def("sample", &sample_packed, "src"_a, "dst"_a, "border"_a, "coordinates"_a.none() = nb::none(),
             "averages"_a.none() = nb::none())
        .def_prop_ro("nbytes", &PackedMap::bytes);
    nb::class_<AxialCamera>(m, "AxialCamera")
        .def(nb::new_(&make_axial), "frame"_a, "x"_a, "y"_a, "width"_a, "height"_a, "first"_a, "last"_a, "radii"_a,
             "origins"_a, "viewpoint"_a)
        .def("project", &project_axial, "targets"_a, "is_near"_a, "pixels"_a, "excess"_a.none());
    m.def("instruction_set", [] { return std::string(kernels().name); });
    m.def(
        "set_instruction_set",
        [](const std::string& name) {
            if (!select_kernels(name.c_str())) raise_invalid("name", "must be an instruction set of this processor");
        },
        "name"_a);
}

}  // namespace omnimirror
