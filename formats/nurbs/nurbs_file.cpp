#include "formats/nurbs/nurbs_file.h"

#include "base/error.h"
#include "base/text_file.h"
#include "base/units.h"
#include "formats/reader_process.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>

namespace haptrace {
namespace {

using nlohmann::json;

constexpr std::size_t kMostPatches = 2000, kMostPoints = 1'000'000, kMostLoopPoints = 100'000;
constexpr double kFarthest = 1e3;  // of a point [m]
constexpr double kLeastWeight = 1e-6, kMostWeight = 1e6;
constexpr double kLeastKnotStep = 1e-9;  // share of the domain, below which rounding decides
constexpr int kPartsOfSpan = 16;         // of a trimming curve, per degree
constexpr std::uintmax_t kLargestJson = std::uintmax_t{256} << 20U;
constexpr ReaderLimits kOcctLimits{
    .memory = std::uint64_t{2} << 30U, .memory_per_byte = 200, .seconds = 20, .bytes_per_second = 100'000};

[[noreturn]] void expected(const std::string& where, const std::string& what) {
  throw input_error(where + ": expected " + what);
}

double number_of(const json& value, const std::string& where) {
  if (!value.is_number()) expected(where, "a number");
  const auto number = value.get<double>();
  if (!std::isfinite(number)) throw input_error(where + ": the number is not finite");
  return number;
}

std::vector<double> numbers_of(const json& value, const std::string& where) {
  if (!value.is_array() || value.size() > kMostPoints) expected(where, "an array of numbers");
  std::vector<double> numbers;
  numbers.reserve(value.size());
  for (std::size_t i = 0; i < value.size(); ++i)
    numbers.push_back(number_of(value[i], fmt::format("{}[{}]", where, i)));
  return numbers;
}

/// Reads a degree for both directions, or [of u, of v].
std::array<int, 2> degrees_of(const json& value, const std::string& where) {
  const auto degree_of = [](const json& one, const std::string& name) {
    if (!one.is_number_integer()) expected(name, "a degree, a whole number");
    const auto degree = one.get<std::int64_t>();
    if (degree < 1 || degree > kMostNurbsDegree)
      throw input_error(fmt::format("{}: the degree is {}; it must be from 1 to {}", name, degree, kMostNurbsDegree));
    return static_cast<int>(degree);
  };
  if (!value.is_array()) {
    const int degree = degree_of(value, where);
    return {degree, degree};
  }
  if (value.size() != 2) expected(where, "one degree, or two: [of u, of v]");
  return {degree_of(value[0], where + "[0]"), degree_of(value[1], where + "[1]")};
}

void check_knots(const std::vector<double>& knots, int degree, int count, const std::string& where) {
  const auto p = static_cast<std::size_t>(degree), n = static_cast<std::size_t>(count);
  if (count < degree + 1)
    throw input_error(fmt::format("{}: degree {} needs at least {} points in this direction; there are {}", where,
                                  degree, degree + 1, count));
  if (knots.size() != n + p + 1)
    throw input_error(fmt::format("{}: there are {} knots; {} points of degree {} need {}", where, knots.size(), count,
                                  degree, n + p + 1));
  for (std::size_t i = 0; i < knots.size(); ++i) {
    if (!std::isfinite(knots[i])) throw input_error(fmt::format("{}[{}]: the knot is not finite", where, i));
    if (i > 0 && knots[i] < knots[i - 1])
      throw input_error(fmt::format("{}[{}]: the knot {} is below the one before, {}; knots must not decrease", where,
                                    i, knots[i], knots[i - 1]));
  }
  const double range = knots[n] - knots[p];
  if (!(range > 0) || !std::isfinite(knots.back() - knots.front()))
    throw input_error(fmt::format("{}: the knots {} and {} leave no range between them", where, p, n));
  for (std::size_t i = 0; i < knots.size();) {
    std::size_t end = i + 1;
    while (end < knots.size() && knots[end] == knots[i]) ++end;
    const bool inside = knots[i] > knots[p] && knots[i] < knots[n];
    if (end - i > p + (inside ? 0 : 1))
      throw input_error(fmt::format("{}[{}]: the knot {} is there {} times; {}", where, i, knots[i], end - i,
                                    inside ? fmt::format("more than {} tear a surface of degree {} apart", p, p)
                                           : fmt::format("at an end, degree {} allows {}", p, p + 1)));
    if (end < knots.size() && knots[end] - knots[i] < kLeastKnotStep * range)
      throw input_error(fmt::format("{}[{}]: the knots {} and {} are closer than rounding; make them equal", where, end,
                                    knots[i], knots[end]));
    i = end;
  }
}

/// Reads a trimming curve {"degree", "knots", "points": [[u, v] or [u, v, weight], ...]} and adds points of it.
void add_curve(const json& value, const std::string& where, NurbsData::Loop& loop) {
  JsonReader reader(value, where);
  const auto degree = static_cast<std::size_t>(reader.require("degree").integer("degree", 1, 1, kMostNurbsDegree));
  const std::vector<double> knots = numbers_of(reader.require("knots").value("knots"), where + ".knots");
  const json points = reader.require("points").value("points");
  reader.finish();
  if (!points.is_array() || points.size() > kMostLoopPoints) expected(where + ".points", "an array of points [u, v]");
  std::vector<Vec3> poles;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::string at = fmt::format("{}.points[{}]", where, i);
    const std::vector<double> numbers = numbers_of(points[i], at);
    if (numbers.size() != 2 && numbers.size() != 3) expected(at, "[u, v] or [u, v, weight]");
    const double weight = numbers.size() == 3 ? numbers[2] : 1;
    if (!(weight >= kLeastWeight && weight <= kMostWeight))
      throw input_error(
          fmt::format("{}: the weight is {}; it must be from {} to {}", at, weight, kLeastWeight, kMostWeight));
    poles.emplace_back(weight * numbers[0], weight * numbers[1], weight);
  }
  check_knots(knots, static_cast<int>(degree), static_cast<int>(poles.size()), where + ".knots");
  const std::size_t parts = degree == 1 ? 1 : kPartsOfSpan * degree;
  if (poles.size() * parts > kMostLoopPoints) throw input_error(where + ": the curve has too many points");
  for (std::size_t span = degree; span < poles.size(); ++span) {
    if (!(knots[span + 1] > knots[span])) continue;
    for (std::size_t part = span == degree ? 0 : 1; part <= parts; ++part) {
      const double share = static_cast<double>(part) / static_cast<double>(parts);
      const double t = knots[span] + share * (knots[span + 1] - knots[span]);
      // De Boor's algorithm.
      std::array<Vec3, kMostNurbsDegree + 1> d;
      for (std::size_t i = 0; i <= degree; ++i) d[i] = poles[span - degree + i];
      for (std::size_t r = 1; r <= degree; ++r)
        for (std::size_t i = degree; i >= r; --i) {
          const double low = knots[span - degree + i], high = knots[span + 1 + i - r];
          const double a = (t - low) / (high - low);
          d[i] = (1 - a) * d[i - 1] + a * d[i];
        }
      loop.emplace_back(d[degree].head<2>() / d[degree].z());
    }
  }
}

/// Reads a closed loop: [[u, v], ...], or a list of curves, each of which begins where the one before ends.
NurbsData::Loop loop_of(const json& value, const std::string& where) {
  if (!value.is_array() || value.empty() || value.size() > kMostLoopPoints)
    expected(where, "a closed loop: an array of points [u, v], or an array of curves");
  NurbsData::Loop loop;
  for (std::size_t i = 0; i < value.size(); ++i) {
    const std::string at = fmt::format("{}[{}]", where, i);
    if (value[i].is_object()) {
      add_curve(value[i], at, loop);
      continue;
    }
    const std::vector<double> numbers = numbers_of(value[i], at);
    if (numbers.size() != 2) expected(at, "a point [u, v]");
    loop.emplace_back(numbers[0], numbers[1]);
  }
  return loop;
}

/// Removes repeated points of a loop.
void tidy_loop(NurbsData::Loop& loop, const Eigen::Vector2d& size) {
  const auto same = [&](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return ((a - b).array().abs() <= 1e-12 * size.array()).all();
  };
  loop.erase(std::unique(loop.begin(), loop.end(), same), loop.end());
  while (loop.size() > 1 && same(loop.front(), loop.back())) loop.pop_back();
}

NurbsData patch_of(JsonReader& reader, double per_si) {
  NurbsData patch;
  const std::string where = reader.where();
  patch.degree = degrees_of(reader.require("degree").value("degree"), where + ".degree");
  patch.knots[0] = numbers_of(reader.require("knots_u").value("knots_u"), where + ".knots_u");
  patch.knots[1] = numbers_of(reader.require("knots_v").value("knots_v"), where + ".knots_v");
  const json rows = reader.require("points").value("points");
  if (!rows.is_array() || rows.empty()) expected(where + ".points", "an array of rows, one for each point along u");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::string row = fmt::format("{}.points[{}]", where, i);
    if (!rows[i].is_array() || rows[i].empty()) expected(row, "an array of points along v, each [x, y, z, weight]");
    if (rows[i].size() != rows[0].size())
      throw input_error(
          fmt::format("{}: there are {} points; the first row has {}", row, rows[i].size(), rows[0].size()));
    if (patch.points.size() + rows[i].size() > kMostPoints)
      throw input_error(fmt::format("{}: there are more than {} points", row, kMostPoints));
    for (std::size_t j = 0; j < rows[i].size(); ++j) {
      const std::string at = fmt::format("{}[{}]", row, j);
      const std::vector<double> numbers = numbers_of(rows[i][j], at);
      if (numbers.size() != 3 && numbers.size() != 4) expected(at, "[x, y, z] or [x, y, z, weight]");
      patch.points.emplace_back(numbers[0] / per_si, numbers[1] / per_si, numbers[2] / per_si,
                                numbers.size() == 4 ? numbers[3] : 1.0);
    }
  }
  patch.count = {static_cast<int>(rows.size()), static_cast<int>(rows[0].size())};
  if (std::optional<JsonReader> trim = reader.object("trim")) {
    const auto loops = [&](const char* key) {
      std::vector<NurbsData::Loop> made;
      const json value = trim->value(key);
      const std::string at = fmt::format("{}.{}", trim->where(), key);
      if (value.is_null()) return made;
      if (!value.is_array()) expected(at, "an array of loops");
      for (std::size_t i = 0; i < value.size(); ++i) made.push_back(loop_of(value[i], fmt::format("{}[{}]", at, i)));
      return made;
    };
    patch.outer = loops("outer");
    patch.holes = loops("holes");
    trim->finish();
  }
  reader.finish();
  check_nurbs(patch, where);
  const Eigen::Vector2d size(patch.most(0) - patch.least(0), patch.most(1) - patch.least(1));
  for (auto* loops : {&patch.outer, &patch.holes})
    for (NurbsData::Loop& loop : *loops) tidy_loop(loop, size);
  return patch;
}

// --- Files of other programs ---

bool names_step(const std::string& ending) {
  return ending == ".step" || ending == ".stp" || ending == ".iges" || ending == ".igs";
}

/// Patches as bytes, to pass them from one process to another.
class Packer {
 public:
  template <class T>
  void put(const T& value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);  // NOLINT(*-reinterpret-cast)
  }
  template <class T>
  void put_all(const std::vector<T>& values) {
    put(values.size());
    bytes_.append(reinterpret_cast<const char*>(values.data()),
                  values.size() * sizeof(T));  // NOLINT(*-reinterpret-cast)
  }
  [[nodiscard]] std::string take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

class Unpacker {
 public:
  explicit Unpacker(std::string_view bytes) : bytes_(bytes) {}
  template <class T>
  void get(T& value) {
    read(&value, sizeof value);
  }
  template <class T>
  void get_all(std::vector<T>& values) {
    values.resize(size(sizeof(T)));
    read(values.data(), values.size() * sizeof(T));
  }
  /// Returns the number of parts of at least `least` bytes that follow.
  std::size_t size(std::size_t least) {
    std::size_t count = 0;
    get(count);
    if (count > bytes_.size() / least) throw input_error("the answer of the reading process is not whole");
    return count;
  }

 private:
  void read(void* to, std::size_t count) {
    if (count > bytes_.size()) throw input_error("the answer of the reading process is not whole");
    if (count > 0) std::memcpy(to, bytes_.data(), count);
    bytes_.remove_prefix(count);
  }
  std::string_view bytes_;
};

std::string packed(const std::vector<NurbsData>& patches) {
  Packer packer;
  packer.put(patches.size());
  for (const NurbsData& patch : patches) {
    packer.put(patch.degree);
    packer.put(patch.count);
    packer.put(patch.turned);
    for (const auto& knots : patch.knots) packer.put_all(knots);
    packer.put_all(patch.points);
    for (const auto* loops : {&patch.outer, &patch.holes}) {
      packer.put(loops->size());
      for (const NurbsData::Loop& loop : *loops) packer.put_all(loop);
    }
  }
  return packer.take();
}

std::vector<NurbsData> unpacked(std::string_view bytes) {
  Unpacker unpacker(bytes);
  std::vector<NurbsData> patches(unpacker.size(sizeof(int)));
  for (NurbsData& patch : patches) {
    unpacker.get(patch.degree);
    unpacker.get(patch.count);
    unpacker.get(patch.turned);
    for (auto& knots : patch.knots) unpacker.get_all(knots);
    unpacker.get_all(patch.points);
    for (auto* loops : {&patch.outer, &patch.holes}) {
      loops->resize(unpacker.size(sizeof(std::size_t)));
      for (NurbsData::Loop& loop : *loops) unpacker.get_all(loop);
    }
  }
  return patches;
}

}  // namespace

void check_nurbs(const NurbsData& patch, const std::string& where) {
  if (patch.count[0] < 1 || patch.count[1] < 1 ||
      patch.points.size() != static_cast<std::size_t>(patch.count[0]) * static_cast<std::size_t>(patch.count[1]))
    throw input_error(where + ".points: the rows do not have the same number of points");
  for (std::size_t side = 0; side < 2; ++side) {
    if (patch.degree[side] < 1 || patch.degree[side] > kMostNurbsDegree)
      throw input_error(fmt::format("{}.degree: the degree is {}; it must be from 1 to {}", where, patch.degree[side],
                                    kMostNurbsDegree));
    check_knots(patch.knots[side], patch.degree[side], patch.count[side],
                where + (side == 0 ? ".knots_u" : ".knots_v"));
  }
  for (std::size_t i = 0; i < patch.points.size(); ++i) {
    const Eigen::Vector4d& point = patch.points[i];
    const auto columns = static_cast<std::size_t>(patch.count[1]);
    const auto at = [&] { return fmt::format("{}.points[{}][{}]", where, i / columns, i % columns); };
    if (!(point.head<3>().cwiseAbs().maxCoeff() < kFarthest))
      throw input_error(fmt::format("{}: the point is not finite, or beyond {} m", at(), kFarthest));
    if (!(point[3] >= kLeastWeight && point[3] <= kMostWeight))
      throw input_error(
          fmt::format("{}: the weight is {}; it must be from {} to {}", at(), point[3], kLeastWeight, kMostWeight));
  }
  const Eigen::Vector2d least(patch.least(0), patch.least(1)), most(patch.most(0), patch.most(1));
  const Eigen::Vector2d slack = 1e-6 * (most - least);
  std::size_t points = 0;
  for (const bool outer : {true, false}) {
    const auto& loops = outer ? patch.outer : patch.holes;
    for (std::size_t i = 0; i < loops.size(); ++i) {
      const std::string at = fmt::format("{}.trim.{}[{}]", where, outer ? "outer" : "holes", i);
      double area = 0;
      for (std::size_t k = 0; k < loops[i].size(); ++k) {
        const Eigen::Vector2d &a = loops[i][k], &b = loops[i][(k + 1) % loops[i].size()];
        area += 0.5 * (a.x() * b.y() - a.y() * b.x());
        if (!a.allFinite() || ((a - least + slack).array() < 0).any() || ((most + slack - a).array() < 0).any())
          throw input_error(
              fmt::format("{}: the point ({}, {}) is outside the patch, which is from ({}, {}) to ({}, {})", at, a.x(),
                          a.y(), least.x(), least.y(), most.x(), most.y()));
      }
      points += loops[i].size();
      if (loops[i].size() < 3 || !(std::abs(area) > 1e-12 * (most - least).prod()))
        throw input_error(at + ": the loop encloses no area");
    }
  }
  if (points > kMostLoopPoints)
    throw input_error(fmt::format("{}.trim: the loops have {} points; the most is {}", where, points, kMostLoopPoints));
}

std::vector<NurbsData> read_nurbs_patches(JsonReader& reader) {
  const std::string text = reader.text("unit", "m");
  const Unit* const unit = find_unit(text, "m");
  if (unit == nullptr)
    throw input_error(fmt::format("{}.unit: '{}' is no length; give m, mm, cm, um or in", reader.where(), text));
  std::vector<NurbsData> patches;
  std::vector<JsonReader> readers = reader.require("patches").objects("patches");
  if (readers.empty()) throw input_error(reader.where() + ": patches: there are none");
  if (readers.size() > kMostPatches)
    throw input_error(
        fmt::format("{}: there are {} patches; the most is {}", reader.where(), readers.size(), kMostPatches));
  patches.reserve(readers.size());
  for (JsonReader& one : readers) patches.push_back(patch_of(one, unit->per_si));
  return patches;
}

std::vector<NurbsData> load_nurbs(const std::string& file) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::is_regular_file(file, error)) throw input_error(file + ": no such file");
  const std::string ending = file_ending(file);
  if (ending == ".json") {
    if (fs::file_size(file, error) > kLargestJson) throw input_error(file + ": is larger than 256 MiB");
    const json whole = load_json(file);
    JsonReader reader(whole, file);
    std::vector<NurbsData> patches = read_nurbs_patches(reader);
    reader.finish();
    return patches;
  }
  if (!names_step(ending))
    throw input_error(fmt::format("{}: patches are read from .json, .step, .stp, .iges and .igs files", file));
  if (!reads_step_files())
    throw input_error(
        fmt::format("{}: this build does not read STEP and IGES files. Install libocct-data-exchange-dev and "
                    "libocct-modeling-algorithms-dev, and build haptrace again",
                    file));
  std::vector<NurbsData> patches =
      unpacked(read_in_process(file, "patches", kOcctLimits, [&] { return packed(load_nurbs_with_occt(file)); }));
  if (patches.empty()) throw input_error(file + ": has no surface");
  if (patches.size() > kMostPatches)
    throw input_error(fmt::format("{}: there are {} patches; the most is {}", file, patches.size(), kMostPatches));
  for (std::size_t i = 0; i < patches.size(); ++i) {
    NurbsData& patch = patches[i];
    const std::string where = fmt::format("{}: face {}", file, i + 1);
    check_nurbs(patch, where);
    const Eigen::Vector2d size(patch.most(0) - patch.least(0), patch.most(1) - patch.least(1));
    for (auto* loops : {&patch.outer, &patch.holes})
      for (NurbsData::Loop& loop : *loops) tidy_loop(loop, size);
  }
  return patches;
}

}  // namespace haptrace
