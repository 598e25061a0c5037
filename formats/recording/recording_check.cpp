#include "base/error.h"
#include "base/json_reader.h"
#include "formats/recording/hdf5_support.h"
#include "formats/recording/recording_layout.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fmt/format.h>
#include <map>
#include <regex>
#include <set>

namespace haptrace {
namespace {

constexpr std::uint64_t kCheckedBlock = 8192;      // rows
constexpr double kQuaternionTolerance = 1e-3;      // from the norm 1
constexpr double kForceTolerance = 1e-6;           // relative to max_force_n
constexpr std::int64_t kEventSlack = 100'000'000;  // [ns] between a missed tick and the event that reports it
constexpr std::int64_t kRepeats = 20'000'000;      // [ns] for which a device may repeat a state without an event
constexpr double kRepeatedTicks = 3;               // ticks that are added to kRepeats
constexpr double kGridSlack = 1e-3;                // [s] between time and tick / rate

/// Collects findings in order. If many rows give the same complaint, keeps the first one with their number.
class Findings {
 public:
  void add(Severity severity, std::string where, std::string what) {
    list_.push_back({severity, std::move(where), std::move(what)});
  }

  void add_row(Severity severity, const std::string& dataset, std::uint64_t row, const std::string& kind,
               std::string what) {
    Repeated& repeated = rows_[dataset + kind];
    if (repeated.count++ > 0) return;
    repeated.index = list_.size();
    add(severity, fmt::format("{}[{}]", dataset, row), std::move(what));
  }

  [[nodiscard]] bool any_error() const {
    return std::any_of(list_.begin(), list_.end(), [](const Finding& f) { return f.severity == Severity::problem; });
  }

  std::vector<Finding> take() {
    for (const auto& [key, repeated] : rows_)
      if (repeated.count > 1) list_[repeated.index].what += fmt::format(" ({} rows in all)", repeated.count);
    rows_.clear();
    return std::move(list_);
  }

 private:
  struct Repeated {
    std::size_t index = 0;
    std::uint64_t count = 0;
  };
  std::vector<Finding> list_;
  std::map<std::string, Repeated> rows_;
};

// ---- the root ----

void check_text(const std::string& name, const std::string& text, Findings& findings) {
  static const std::regex kUuid("[0-9a-fA-F]{8}(-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}");
  static const std::regex kTime(
      "\\d{4}-(0[1-9]|1[0-2])-(0[1-9]|[12]\\d|3[01])[Tt]([01]\\d|2[0-3]):[0-5]\\d:([0-5]\\d|60)"
      "(\\.\\d+)?([Zz]|[+-]00:00)");
  static const std::regex kVersion("1\\.\\d+");
  const auto expect = [&](bool right, const char* expected) {
    if (!right) findings.add(Severity::problem, "/@" + name, fmt::format("'{}' is not {}", text, expected));
  };
  if (name == "uuid" || name == "part_of") expect(std::regex_match(text, kUuid), "a UUID");
  if (name == "created") expect(std::regex_match(text, kTime), "a time of RFC 3339 in UTC, as in 2026-01-31T12:00:00Z");
  if (name == "format_version") expect(std::regex_match(text, kVersion), "a version 1.x");
  if (name == "clock") expect(text == "monotonic" || text == "virtual", "'monotonic' or 'virtual'");
}

void check_number(const std::string& name, double value, Findings& findings) {
  if (!std::isfinite(value))
    findings.add(Severity::problem, "/@" + name, fmt::format("{} is not a finite number", value));
  else if (value < 0 || (name == "rate_hz" && value == 0))
    findings.add(Severity::problem, "/@" + name, fmt::format("{} is not positive", value));
}

void check_attribute(hid_t root, const layout::Attribute& attribute, Findings& findings) {
  const std::string where = std::string("/@") + attribute.name;
  if (H5Aexists(root, attribute.name) <= 0) {
    if (!attribute.of_parts && !attribute.optional) findings.add(Severity::problem, where, "is missing");
    return;
  }
  const auto wrong_type = [&](const char* expected) {
    findings.add(Severity::problem, where, fmt::format("is not {}", expected));
  };
  std::string text;
  double number = 0;
  bool flag = false;
  std::uint32_t count = 0;
  if (std::holds_alternative<std::uint32_t RecordingHeader::*>(attribute.member)) {
    if (!hdf5::read_attribute(root, attribute.name, count) || count == 0) wrong_type("a number from 1");
    return;
  }
  if (std::holds_alternative<double RecordingHeader::*>(attribute.member)) {
    if (!hdf5::read_attribute(root, attribute.name, number)) return wrong_type("a number");
    return check_number(attribute.name, number, findings);
  }
  if (std::holds_alternative<bool RecordingHeader::*>(attribute.member)) {
    if (!hdf5::read_attribute(root, attribute.name, flag)) return wrong_type("an integer, 0 or 1");
    if (!flag && std::string_view(attribute.name) == "complete")
      findings.add(Severity::warning, where,
                   "the recording was not finished: its writer is still running, was killed or failed");
    return;
  }
  if (!hdf5::read_attribute(root, attribute.name, text)) return wrong_type("text");
  check_text(attribute.name, text, findings);
  if (std::holds_alternative<nlohmann::json RecordingHeader::*>(attribute.member)) {
    try {
      parse_json(text, "not JSON");
    } catch (const Error& error) {
      findings.add(Severity::problem, where, error.what());
    }
  }
}

/// Returns false if a part of the recording lies in another file; nothing else is checked then.
bool check_inside(hid_t file, Findings& findings) {
  for (const std::string& path : layout::paths())
    if (std::string outside = hdf5::why_outside(file, path); !outside.empty())
      findings.add(Severity::problem, path, std::move(outside));
  return !findings.any_error();
}

void check_root(hid_t root, Findings& findings) {
  std::string format;
  if (!hdf5::read_attribute(root, "format", format) || format != layout::kFormat)
    findings.add(Severity::problem, "/@format", fmt::format("is not '{}'", layout::kFormat));
  for (const layout::Attribute& attribute : layout::attributes()) check_attribute(root, attribute, findings);
  if (H5Lexists(root, layout::kMeta, H5P_DEFAULT) > 0 && !hdf5::open_object(root, layout::kMeta))
    findings.add(Severity::problem, layout::kMeta, "is damaged: the metadata cannot be read");
}

// ---- the datasets ----

void check_annotation(hid_t dataset, const std::string& path, const char* name, const char* expected, Severity severity,
                      Findings& findings) {
  const std::string where = path + "/@" + name;
  std::string text;
  if (!hdf5::read_attribute(dataset, name, text))
    findings.add(Severity::problem, where, "is missing");
  else if (expected != nullptr && text != expected)
    findings.add(severity, where, fmt::format("is '{}' instead of '{}'", text, expected));
}

void check_storage(hid_t dataset, const std::string& path, Findings& findings) {
  const hdf5::Properties creation(H5Dget_create_plist(dataset));
  if (H5Pget_layout(creation.get()) != H5D_CHUNKED)
    return findings.add(Severity::problem, path, "is not chunked, so it cannot be followed live");
  const hdf5::Space space(H5Dget_space(dataset));
  std::vector<hsize_t> limits(hdf5::shape(dataset).size());
  H5Sget_simple_extent_dims(space.get(), nullptr, limits.data());
  if (!limits.empty() && limits[0] != H5S_UNLIMITED)
    findings.add(Severity::problem, path, "cannot be extended: its first dimension is limited");
}

void check_fill_value(hid_t dataset, const std::string& path, Findings& findings) {
  const hdf5::Properties creation(H5Dget_create_plist(dataset));
  double fill = 0;
  if (H5Pget_fill_value(creation.get(), H5T_NATIVE_DOUBLE, &fill) < 0 || !std::isnan(fill))
    findings.add(Severity::problem, path, fmt::format("its fill value is {} instead of NaN", fill));
}

/// Checks a column. Returns its number of rows if it has the right shape.
std::optional<hsize_t> check_column(hid_t file, const layout::Column& column, Findings& findings) {
  const std::string path = column.path();
  const hdf5::Dataset dataset = hdf5::open_dataset(file, path);
  if (!dataset) {
    findings.add(Severity::problem, path, "is missing");
    return std::nullopt;
  }
  const hdf5::Type type(H5Dget_type(dataset.get()));
  if (H5Tequal(type.get(), hdf5::stored_type(column.element)) <= 0)
    findings.add(Severity::problem, path, fmt::format("does not hold little-endian {}", to_string(column.element)));
  check_storage(dataset.get(), path, findings);
  if (layout::is_float(column.element) && H5Tget_class(type.get()) == H5T_FLOAT)
    check_fill_value(dataset.get(), path, findings);
  check_annotation(dataset.get(), path, "units", column.units, Severity::problem, findings);
  check_annotation(dataset.get(), path, "description", nullptr, Severity::problem, findings);
  const std::vector<hsize_t> shape = hdf5::shape(dataset.get());
  if (shape.size() != (column.width > 1 ? 2 : 1) || (column.width > 1 && shape[1] != column.width)) {
    findings.add(Severity::problem, path,
                 fmt::format("has the shape [{}] instead of [N{}]", fmt::join(shape, ", "),
                             column.width > 1 ? fmt::format(", {}", column.width) : ""));
    return std::nullopt;
  }
  return shape[0];
}

void check_columns(hid_t file, bool complete, Findings& findings) {
  const RecordingColumns present = hdf5::present_columns(file);
  std::vector<std::pair<std::string, hsize_t>> lengths;
  for (const layout::Column& column : layout::columns())
    if (column.in(present))
      if (const auto rows = check_column(file, column, findings)) lengths.emplace_back(column.path(), *rows);
  if (lengths.empty()) return;
  const auto by_length = [](const auto& a, const auto& b) { return a.second < b.second; };
  const hsize_t longest = std::max_element(lengths.begin(), lengths.end(), by_length)->second;
  for (const auto& [path, rows] : lengths)
    if (rows < longest)
      findings.add(complete ? Severity::problem : Severity::warning, path,
                   fmt::format("has {} rows where others have {}", rows, longest));
}

void check_events_dataset(hid_t file, Findings& findings) {
  const hdf5::Dataset dataset = hdf5::open_dataset(file, layout::kEvents);
  if (!dataset) return findings.add(Severity::problem, layout::kEvents, "is missing");
  const hdf5::Type type(H5Dget_type(dataset.get()));
  const auto member_class = [&](const char* name) {
    const int index = H5Tget_class(type.get()) == H5T_COMPOUND ? H5Tget_member_index(type.get(), name) : -1;
    return index < 0 ? H5T_NO_CLASS : H5Tget_member_class(type.get(), static_cast<unsigned>(index));
  };
  bool fixed_text = member_class("text") == H5T_STRING;
  if (fixed_text) {
    const hdf5::Type text(
        H5Tget_member_type(type.get(), static_cast<unsigned>(H5Tget_member_index(type.get(), "text"))));
    fixed_text = H5Tis_variable_str(text.get()) == 0;
  }
  if (member_class("time") != H5T_FLOAT || member_class("code") != H5T_INTEGER || !fixed_text)
    findings.add(Severity::problem, layout::kEvents,
                 "is not a compound of time float64, code int32 and text of fixed length");
  if (hdf5::shape(dataset.get()).size() != 1)
    findings.add(Severity::problem, layout::kEvents, "is not of the shape [M]");
  check_storage(dataset.get(), layout::kEvents, findings);
  check_annotation(dataset.get(), layout::kEvents, "units", nullptr, Severity::problem, findings);
  check_annotation(dataset.get(), layout::kEvents, "description", nullptr, Severity::problem, findings);
}

// ---- the values ----

/// Checks that no value is infinite, and that NaN stands only for "not measured" and "no reference".
void check_finite(hid_t file, const layout::Column& column, std::uint64_t rows, bool values_lost,
                  const std::function<void(std::uint64_t)>& progress, Findings& findings) {
  const std::string path = column.path();
  const std::string name = column.name;
  const bool never_nan = name == "time" || name == "position" || name == "latency";
  const bool all_or_none = name == "velocity" || name == "force";
  const hdf5::Dataset dataset = hdf5::open_dataset(file, path);
  std::vector<double> block;
  std::uint64_t nans = 0, first_nan = 0;
  for (std::uint64_t first = 0; first < rows; first += kCheckedBlock) {
    const std::uint64_t count = std::min(kCheckedBlock, rows - first);
    block.resize(count * column.width);
    hdf5::read_rows(dataset.get(), path, H5T_NATIVE_DOUBLE, first, count, block.data());
    for (std::uint64_t i = 0; i < count; ++i) {
      const auto begin = block.begin() + static_cast<std::ptrdiff_t>(i * column.width);
      const auto end = begin + static_cast<std::ptrdiff_t>(column.width);
      if (std::any_of(begin, end, [](double v) { return std::isinf(v); }))
        findings.add_row(Severity::problem, path, first + i, "inf", "is infinite");
      if (std::none_of(begin, end, [](double v) { return std::isnan(v); })) continue;
      if (nans++ == 0) first_nan = first + i;
      if (never_nan) findings.add_row(Severity::problem, path, first + i, "nan", "is NaN");
    }
    progress(first + count);
  }
  if (all_or_none && nans > 0 && nans < rows)
    findings.add(
        values_lost ? Severity::warning : Severity::problem, fmt::format("{}[{}]", path, first_nan),
        values_lost
            ? fmt::format("is NaN ({} rows in all): these could not be recovered", nans)
            : fmt::format("is NaN ({} rows in all); the column must have a value in every row or in none", nans));
}

bool tells_of_gap(EventCode code) {
  return code == EventCode::overrun || code == EventCode::samples_lost || code == EventCode::paused ||
         code == EventCode::resumed || code == EventCode::device_lost || code == EventCode::device_found ||
         code == EventCode::states_stopped || code == EventCode::states_resumed;
}

/// Checks the rules between samples, and between samples and events. Called with every sample in order.
class Laws {
 public:
  Laws(const RecordingHeader& header, const std::vector<StoredEvent>& events, Findings& findings)
      : header_(header), findings_(findings), paced_(header.clock == "monotonic") {
    for (const StoredEvent& event : events) {
      const auto code = static_cast<EventCode>(event.code);
      if (tells_of_gap(code) && std::abs(event.time) < 9e9) losses_.insert(std::llround(event.time * 1e9));
    }
  }

  void operator()(std::uint64_t row, const Sample& sample) {
    if (row == 0)
      first_ = sample;
    else
      check_step(row, sample);
    check_alone(row, sample);
    previous_ = sample;
  }

  [[nodiscard]] double end() const { return static_cast<double>(previous_.time_ns) * 1e-9; }

 private:
  void check_alone(std::uint64_t row, const Sample& s) {
    const auto phase = static_cast<unsigned>(s.phase);
    if (phase > static_cast<unsigned>(Phase::stopped))
      findings_.add_row(Severity::problem, "/samples/phase", row, "",
                        fmt::format("is {}, which is not a phase (0 to 5)", phase));
    const double force = s.force.norm();
    if (header_.max_force_n > 0 && force > header_.max_force_n * (1 + kForceTolerance))
      findings_.add_row(
          Severity::problem, "/samples/force", row, "max",
          fmt::format("has the magnitude {:.6g} N, more than max_force_n = {:.6g} N", force, header_.max_force_n));
    check_unit(row, "/samples/orientation", s.orientation);
    check_unit(row, "/samples/reference_orientation", s.reference_orientation);
    if (s.latency < 0)
      findings_.add_row(Severity::warning, "/samples/latency", row, "negative",
                        fmt::format("is negative: {:.3g} s", s.latency));
  }

  void check_unit(std::uint64_t row, const char* where, const Quat& orientation) {
    const double norm = orientation.norm();
    if (!std::isnan(norm) && std::abs(norm - 1) > kQuaternionTolerance)
      findings_.add_row(Severity::problem, where, row, "unit",
                        fmt::format("is not a unit quaternion: its norm is {:.6g}", norm));
  }

  void check_step(std::uint64_t row, const Sample& s) {
    if (s.time_ns <= previous_.time_ns)
      findings_.add_row(
          Severity::problem, "/samples/time", row, "order",
          fmt::format("{:.9g} s does not come after {:.9g} s of the row before", seconds(s), seconds(previous_)));
    if (s.tick <= previous_.tick)
      return findings_.add_row(Severity::problem, "/samples/tick", row, "order",
                               fmt::format("{} does not come after {} of the row before", s.tick, previous_.tick));
    // Ticks without a new sample from the device leave no row, and no event if they are few.
    const bool repeats =
        paced_ && s.time_ns - previous_.time_ns <= kRepeats + std::llround(kRepeatedTicks * 1e9 / header_.rate_hz);
    if (s.tick > previous_.tick + 1 && !repeats) {
      const auto told = losses_.lower_bound(previous_.time_ns - kEventSlack);
      if (told == losses_.end() || *told > s.time_ns + kEventSlack)
        findings_.add_row(
            Severity::warning, "/samples/tick", row, "gap",
            fmt::format("{} ticks are missing before it, and no event reports them", s.tick - previous_.tick - 1));
    }
    // A tick wakes on the grid of the rate, later by its latency. A resampled row lies on the grid itself, with the
    // latency of the row before it. A path stored as a recording has no such grid.
    const double grid = static_cast<double>(s.tick - first_.tick) / header_.rate_hz;
    const double from_grid = seconds(s) - seconds(first_) - grid;
    const double off = from_grid - (s.latency - first_.latency);
    if (paced_ && std::min(std::abs(off), std::abs(from_grid)) > 1 / header_.rate_hz + kGridSlack + 1e-4 * grid)
      findings_.add_row(Severity::warning, "/samples/time", row, "grid",
                        fmt::format("is {:.3g} s away from tick / rate_hz + latency", off));
  }

  static double seconds(const Sample& s) { return static_cast<double>(s.time_ns) * 1e-9; }

  const RecordingHeader& header_;
  Findings& findings_;
  bool paced_;
  std::set<std::int64_t> losses_;  // [ns]
  Sample first_, previous_;
};

void check_events(const std::vector<StoredEvent>& events, double begin, double end, Findings& findings) {
  constexpr double kSlack = 1;  // [s]: for events before the first sample and after the last
  for (std::size_t i = 0; i < events.size(); ++i) {
    const double t = events[i].time;
    if (!std::isfinite(t) || t < begin - kSlack || t > end + kSlack)
      findings.add_row(Severity::warning, layout::kEvents, i, "range",
                       fmt::format("its time, {:.9g} s, is outside the samples' {:.9g} to {:.9g} s", t, begin, end));
    if (events[i].code <= 0)
      findings.add_row(Severity::problem, layout::kEvents, i, "code",
                       fmt::format("its code, {}, is not positive", events[i].code));
    if (events[i].code == static_cast<int>(EventCode::values_lost))
      findings.add_row(Severity::warning, layout::kEvents, i, "damage",
                       fmt::format("reports damage from before haptrace recover: {}", events[i].text));
  }
}

/// Checks that the stored summaries are those of the rows. Called with every sample in order.
class OverviewLaw {
 public:
  /// `rounded`: rounding step of the positions if the summaries were made before rounding; 0 otherwise.
  OverviewLaw(const RecordingReader& reader, double rounded, Findings& findings)
      : findings_(findings), rounded_(rounded) {
    // The reader may have computed the last ones from the rows just now; these say nothing about the file.
    std::size_t made = 0;
    blocks_ = reader.overview([&](std::uint64_t) { ++made; });
    blocks_.resize(blocks_.size() - made);
  }

  void operator()(std::span<const Sample> samples) {
    while (!samples.empty() && block_ < blocks_.size()) {
      const RecordingSummary& stored = blocks_[block_];
      const std::size_t count = std::min<std::size_t>(samples.size(), stored.rows - summariser_.rows());
      summariser_.add(samples.first(count));
      samples = samples.subspan(count);
      if (summariser_.rows() < stored.rows) continue;
      compare(stored, summariser_.take());
      ++block_;
    }
  }

 private:
  void compare(const RecordingSummary& stored, const RecordingSummary& found) {
    std::array<std::byte, 3 * sizeof(double)> a{}, b{};
    for (const layout::OverviewField& field : layout::overview_fields()) {
      field.pack(stored, a.data());
      field.pack(found, b.data());
      if (same(field, a.data(), b.data())) continue;
      findings_.add_row(Severity::problem, layout::kOverview, block_, field.name,
                        fmt::format("its {} differs from that of the rows", field.name));
    }
  }

  [[nodiscard]] bool same(const layout::OverviewField& field, const std::byte* a, const std::byte* b) const {
    constexpr double kSame = 1e-9;  // relative to the larger one: the order of sums may differ
    if (!field.floating) return std::memcmp(a, b, field.bytes()) == 0;
    // Rounding changes path lengths and speeds; positions stay close.
    if (rounded_ > 0 && field.width == 1) return true;
    for (std::size_t i = 0; i < field.width; ++i) {
      double x = 0, y = 0;
      std::memcpy(&x, a + 8 * i, sizeof x);
      std::memcpy(&y, b + 8 * i, sizeof y);
      if (x == y || (std::isnan(x) && std::isnan(y))) continue;
      if (!(std::abs(x - y) <= rounded_ + kSame * std::max(std::abs(x), std::abs(y)))) return false;
    }
    return true;
  }

  std::vector<RecordingSummary> blocks_;
  Findings& findings_;
  double rounded_;
  std::size_t block_ = 0;
  Summariser summariser_;
};

/// Returns the rounding step of the positions in a file whose summaries were made before rounding; 0 if there is none.
double rounding_before_1_1(hid_t file, const std::string& format_version) {
  if (layout::has_grid(format_version)) return 0;
  double step = 0;
  for (const layout::Column& column : layout::columns()) {
    const hdf5::Dataset dataset = hdf5::open_dataset(file, column.path());
    if (const std::optional<int> digits = hdf5::decimal_digits(dataset))
      step = std::max(step, column.quantity == &Precision::position ? layout::DecimalGrid(*digits).step() : 1e-300);
  }
  return step;
}

void check_clocks(hid_t file, const RecordingReader& reader, Findings& findings) {
  const hdf5::Dataset dataset = hdf5::open_dataset(file, layout::kClocks);
  if (!dataset) return;
  const std::vector<ClockReading> readings = reader.clocks();
  if (const std::vector<hsize_t> shape = hdf5::shape(dataset.get()); shape.size() != 2 || readings.size() != shape[0])
    findings.add(Severity::problem, layout::kClocks, "is damaged: some readings differ from those that were recorded");
  for (std::size_t i = 1; i < readings.size(); ++i)
    if (readings[i].time_ns <= readings[i - 1].time_ns)
      findings.add_row(Severity::problem, layout::kClocks, i, "order", "does not come after the reading before");
}

/// Checks the rules of /contacts.
void check_contacts(const RecordingReader& reader, Findings& findings) {
  if (!reader.columns().contacts) return;
  constexpr double kSlack = 1e-6;  // of a unit vector's length
  const std::size_t objects = reader.header().scene.objects.size();
  std::optional<ContactSample> before;
  for (std::uint64_t first = 0; first < reader.contact_rows(); first += kCheckedBlock) {
    const std::vector<ContactSample> block = reader.contacts(first, kCheckedBlock);
    for (std::size_t i = 0; i < block.size(); ++i) {
      const ContactSample& contact = block[i];
      const auto add = [&](const char* kind, const char* what) {
        findings.add_row(Severity::problem, layout::kContacts, first + i, kind, what);
      };
      if (before && std::pair(contact.tick, contact.object) <= std::pair(before->tick, before->object))
        add("order", "does not come after the contact before, in the order of ticks and objects");
      if (objects > 0 && contact.object >= objects) add("object", "names an object that the scene does not have");
      if (!is_finite(contact.proxy) || !is_finite(contact.force) || !std::isfinite(contact.depth))
        add("finite", "is not finite");
      if (!(std::abs(contact.normal.norm() - 1) < kSlack)) add("normal", "has a normal that is no unit vector");
      before = contact;
    }
  }
  reader.verify_contacts();
}

/// Checks that /event_list equals /events. Files before 1.1 have none.
void check_event_list(hid_t file, const std::vector<StoredEvent>& events, Findings& findings) {
  for (const layout::EventColumn& column : layout::kEventColumns) {
    const hdf5::Dataset dataset = hdf5::open_dataset(file, column.path);
    if (!dataset) continue;
    const std::vector<hsize_t> shape = hdf5::shape(dataset.get());
    if (shape.size() != 1 || shape[0] != events.size()) {
      findings.add(Severity::problem, column.path,
                   fmt::format("is not of the shape [{}], as /events is", events.size()));
      continue;
    }
    std::vector<char> rows(column.bytes * events.size());
    if (!rows.empty())
      hdf5::read_rows(dataset.get(), column.path, hdf5::event_column_type(column).get(), 0, events.size(), rows.data());
    for (std::size_t i = 0; i < events.size(); ++i) {
      const char* row = rows.data() + i * column.bytes;
      bool same = false;
      if (column.offset == layout::EventRow::kTime)
        same = std::memcmp(row, &events[i].time, column.bytes) == 0;
      else if (column.offset == layout::EventRow::kCode)
        same = std::memcmp(row, &events[i].code, column.bytes) == 0;
      else
        same = std::string_view(row, strnlen(row, column.bytes)) == events[i].text;
      if (!same) findings.add_row(Severity::problem, column.path, i, "event", "differs from the entry in /events");
    }
  }
}

void check_values(hid_t file, const std::string& name, const std::function<void(double)>& progress,
                  Findings& findings) {
  RecordingReader reader(name, RecordingReader::Parts::this_file);
  reader.on_damage([&](const RecordingReader::Damage& damage) {
    findings.add(Severity::problem, fmt::format("{}[{}]", damage.path, damage.first),
                 fmt::format("{} (rows {} to {})", damage.what, damage.first, damage.first + damage.count - 1));
  });
  const std::vector<StoredEvent> events = reader.events();
  const bool values_lost = std::any_of(events.begin(), events.end(), [](const StoredEvent& event) {
    return event.code == static_cast<int>(EventCode::values_lost);
  });
  // One pass for each column, and one for all columns together.
  const auto passes = 1 + std::count_if(layout::columns().begin(), layout::columns().end(), [&](const auto& column) {
                        return column.in(reader.columns()) && layout::is_float(column.element);
                      });
  std::ptrdiff_t pass = 0;
  const auto advance = [&](std::uint64_t row) {
    if (progress)
      progress((static_cast<double>(pass) + static_cast<double>(row) / static_cast<double>(reader.rows())) /
               static_cast<double>(passes));
  };
  for (const layout::Column& column : layout::columns()) {
    if (!column.in(reader.columns()) || !layout::is_float(column.element)) continue;
    check_finite(file, column, reader.rows(), values_lost, advance, findings);
    ++pass;
  }
  if (reader.rows() == 0) return findings.add(Severity::warning, "/samples", "there are no samples");

  const RecordingHeader header = reader.header();
  Laws laws(header, events, findings);
  OverviewLaw overview(reader, rounding_before_1_1(file, header.format_version), findings);
  double begin = 0;
  for (std::uint64_t first = 0; first < reader.rows(); first += kCheckedBlock) {
    const std::vector<Sample> samples = reader.read(first, kCheckedBlock);
    if (first == 0) begin = static_cast<double>(samples.front().time_ns) * 1e-9;
    for (std::size_t i = 0; i < samples.size(); ++i) laws(first + i, samples[i]);
    overview(samples);
    advance(first + samples.size());
  }
  check_events(events, begin, laws.end(), findings);
  check_clocks(file, reader, findings);
  check_contacts(reader, findings);
  if (reader.header().complete) check_event_list(file, events, findings);
}

std::vector<Finding> check_file(const std::string& file, const std::function<void(double)>& progress) {
  const hdf5::File opened = hdf5::open_to_read(file);
  Findings findings;
  if (!check_inside(opened.get(), findings)) return findings.take();
  check_root(opened.get(), findings);
  bool complete = false;
  hdf5::read_attribute(opened.get(), "complete", complete);
  check_columns(opened.get(), complete, findings);
  check_events_dataset(opened.get(), findings);
  try {
    check_values(opened.get(), file, progress, findings);
  } catch (const Error& error) {
    if (findings.any_error())
      findings.add(Severity::note, "/samples", fmt::format("not all values were checked: {}", error.what()));
    else
      findings.add(Severity::problem, "/samples", error.what());
  }
  return findings.take();
}

}  // namespace

std::vector<Finding> check_recording(const std::string& file, const std::function<void(double)>& progress,
                                     bool partial) {
  const hdf5::Silence silence;
  std::vector<Finding> all;
  std::vector<std::string> files{file};
  try {
    const RecordingReader reader(file, RecordingReader::Parts::present);
    files = reader.files();
    for (const std::string& missing : reader.missing_parts())
      all.push_back({partial ? Severity::warning : Severity::problem, missing,
                     "is a part of this recording, but is missing or cannot be read"});
  } catch (const Error&) {
    // check_file() reports why.
  }
  for (std::size_t part = 0; part < files.size(); ++part) {
    const auto of_all = [&](double done) {
      if (progress) progress((static_cast<double>(part) + done) / static_cast<double>(files.size()));
    };
    for (Finding& finding : check_file(files[part], of_all)) {
      if (part > 0) finding.where = fmt::format("{}: {}", files[part], finding.where);
      all.push_back(std::move(finding));
    }
  }
  return all;
}

}  // namespace haptrace
