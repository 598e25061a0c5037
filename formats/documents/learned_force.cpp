#include "formats/documents/learned_force.h"

#include "base/error.h"
#include "base/json_digest.h"
#include "base/json_reader.h"
#include "base/output_file.h"
#include "control/design/lqg_search.h"

#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kLearnedFormat = "haptrace-learned-force";
constexpr const char* kLearnedVersion = "1.0";
constexpr double kMostRows = 1e6;
constexpr double kSameMass = 0.1;    // relative difference of equal masses
constexpr double kSameSpeed = 1e-9;  // relative difference of equal speeds

std::vector<Vec3> rows_from_json(const json& rows, const std::string& where) {
  if (!rows.is_array() || rows.empty() || static_cast<double>(rows.size()) > kMostRows)
    throw input_error(fmt::format("{}: force_n: expected 1 to {:.0f} forces", where, kMostRows));
  std::vector<Vec3> result;
  result.reserve(rows.size());
  for (const json& row : rows) {
    Vec3 force = nan3();
    if (row.is_array() && row.size() == 3)
      for (std::size_t axis = 0; axis < 3; ++axis)
        if (row[axis].is_number()) force[static_cast<Eigen::Index>(axis)] = row[axis].get<double>();
    if (!is_finite(force))
      throw input_error(fmt::format("{}: force_n[{}]: expected three numbers", where, result.size()));
    result.push_back(force);
  }
  return result;
}

/// Rounds forces to 0.1 mN, far below what any device can produce.
json rounded(const Vec3& force) {
  json row = json::array();
  for (const double newtons : force) row.push_back(std::round(1e4 * newtons) / 1e4);
  return row;
}

class Fnv1a {
 public:
  void add(const void* data, std::size_t size) {
    for (const auto* byte = static_cast<const unsigned char*>(data); size > 0; ++byte, --size)
      hash_ = (hash_ ^ *byte) * 1099511628211U;
  }
  [[nodiscard]] std::string text() const { return fmt::format("{:016x}", hash_); }

 private:
  std::uint64_t hash_ = 14695981039346656037U;
};

}  // namespace

std::string digest_of(const PathSource& path) {
  Fnv1a hash;
  const auto add = [&](double value) { hash.add(&value, sizeof value); };
  constexpr std::uint64_t kRows = 65'536;
  const double begin = path.facts().begin;
  for (std::uint64_t first = 0; first < path.facts().rows; first += kRows) {
    const Path rows = path.read(first, kRows);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      add(rows.time[i] - begin);
      for (const double x : rows.position[i]) add(x);
    }
  }
  return hash.text();
}

std::string learned_file(const std::string& path, const DeviceIdentity& device, const std::string& change) {
  const fs::path folder = path + ".learned";
  if (change.empty()) return (folder / profile_name(device)).string();
  Fnv1a hash;
  hash.add(change.data(), change.size());
  return (folder / hash.text() / profile_name(device)).string();
}

void check_learned_output(const std::string& file) {
  check_output_in_new_folders(file, true);
}

void save_learned(const LearnedPath& learned, const std::string& file) {
  std::error_code error;
  const fs::path folder = fs::path(file).parent_path();
  if (!folder.empty()) fs::create_directories(folder, error);  // a bare file name lies in the working folder
  if (error)
    throw input_error(
        fmt::format("{}: the folder cannot be created ({}); choose another place with --learned FILE.json",
                    folder.string(), error.message()));
  json rows = json::array();
  for (const Vec3& force : learned.table.force) rows.push_back(rounded(force));
  const json root{
      {"format", kLearnedFormat},         {"format_version", kLearnedVersion},  {"created", learned.created},
      {"software", learned.software},     {"backend", learned.device.backend},  {"model", learned.device.model},
      {"serial", learned.device.serial},  {"path_digest", learned.path_digest}, {"speed", learned.speed},
      {"mass_kg", json_of(learned.mass)}, {"repetitions", learned.repetitions}, {"rms_error_m", learned.rms_error},
      {"step_s", learned.table.step},     {"force_n", std::move(rows)}};
  save_json(with_digest(root), file, true);
}

std::optional<LearnedPath> load_learned(const std::string& file) {
  if (!fs::exists(file)) return std::nullopt;
  const json root = without_digest(load_json(file), file, "learn again (--forget)");
  JsonReader reader(root, file);
  if (const std::string format = reader.text("format", ""); format != kLearnedFormat)
    throw input_error(fmt::format("{}: format is '{}', not {}", file, format, kLearnedFormat));
  if (const std::string version = reader.text("format_version", ""); version != kLearnedVersion)
    throw input_error(fmt::format("{}: format_version is '{}', but this program reads {}; learn again (--forget)", file,
                                  version, kLearnedVersion));
  LearnedPath learned;
  learned.created = reader.text("created", "");
  learned.software = reader.text("software", "");
  learned.device = {reader.text("backend", ""), reader.text("model", ""), reader.text("serial", "")};
  learned.path_digest = reader.text("path_digest", "");
  learned.speed = reader.number("speed", 0, 1e-6, 1e6);
  learned.mass = reader.vector("mass_kg", Vec3::Zero(), 0, 1e3);
  learned.repetitions = static_cast<int>(reader.number("repetitions", 0, 0, 1e6));
  learned.rms_error = reader.number("rms_error_m", 0, 0, 1e3);
  learned.table.step = reader.number("step_s", 0, 1e-6, 1e3);
  if (learned.table.step == 0) throw input_error(file + ": step_s is missing; learn again (--forget)");
  learned.table.force = rows_from_json(root.value("force_n", json()), file);
  return learned;
}

namespace {

/// Returns true if forces [N] at equal steps [s] may come from learning, which low-passes: the power of their second
/// differences, over their own, is below that of a sine at kFastest.
bool is_low_passed(const std::vector<Vec3>& forces, double step) {
  constexpr double kFastest = 4 / 3. * kMostLearning;  // [Hz]
  constexpr std::size_t kEnough = 50;
  if (forces.size() < kEnough) return true;
  Vec3 mean = Vec3::Zero();
  for (const Vec3& force : forces) mean += force / static_cast<double>(forces.size());
  double power = 0, rough = 0;
  for (std::size_t i = 1; i + 1 < forces.size(); ++i) {
    power += (forces[i] - mean).squaredNorm();
    rough += (forces[i - 1] - 2 * forces[i] + forces[i + 1]).squaredNorm();
  }
  return rough <= std::pow(2 * std::sin(std::numbers::pi * std::min(kFastest * step, 0.5)), 4) * power;
}

}  // namespace

std::string check_learned(const LearnedPath& learned, const DeviceIdentity& device, const std::string& path_digest,
                          double speed, const Vec3& mass, double max_force) {
  if (learned.device != device)
    return fmt::format("it was learned on another device, {} {}", learned.device.model, learned.device.serial);
  if (learned.path_digest != path_digest) return "it was learned on another path";
  if (std::abs(learned.speed - speed) > kSameSpeed * speed)
    return fmt::format("it was learned at {} times the path's speed", learned.speed);
  if ((learned.mass - mass).norm() > kSameMass * mass.norm())
    return "a later calibration of the device found another mass";
  constexpr double kMost = 2;  // a hand may pull with more force than the device has
  for (const Vec3& force : learned.table.force)
    if (max_force > 0 && force.norm() > kMost * max_force)
      return fmt::format("it contains a force of {:.1f} N, far beyond the device's {:.1f} N; learn again (--forget)",
                         force.norm(), max_force);
  if (!is_low_passed(learned.table.force, learned.table.step / speed))
    return "its forces shake faster than learning follows: it is damaged; learn again (--forget)";
  return {};
}

}  // namespace haptrace
