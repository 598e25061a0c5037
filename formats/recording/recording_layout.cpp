#include "formats/recording/recording_layout.h"

#include "base/enum_names.h"
#include "base/number.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <xxhash.h>

namespace haptrace {
namespace layout {
namespace {

static_assert(std::endian::native == std::endian::little, "rows are copied to the file as they lie in memory");

constexpr Attribute kAttributes[] = {
    {"format_version", &RecordingHeader::format_version},
    {"uuid", &RecordingHeader::uuid},
    {"created", &RecordingHeader::created},
    {"software", &RecordingHeader::software},
    {"title", &RecordingHeader::title},
    {"subject", &RecordingHeader::subject},
    {"operator", &RecordingHeader::operator_name},
    {"notes", &RecordingHeader::notes},
    {"rate_hz", &RecordingHeader::rate_hz},
    {"clock", &RecordingHeader::clock},
    {"complete", &RecordingHeader::complete},
    {"config", &RecordingHeader::config},
    {kWarnings, &RecordingHeader::warnings, false, true},
    {"device_name", &RecordingHeader::device_name},
    {"device_model", &RecordingHeader::device_model},
    {"device_serial", &RecordingHeader::device_serial},
    {"device_backend", &RecordingHeader::device_backend},
    {"position_resolution_m", &RecordingHeader::position_resolution_m},
    {"max_force_n", &RecordingHeader::max_force_n},
    {"part", &RecordingHeader::part, true},
    {"part_of", &RecordingHeader::part_of, true},
    {kContinued, &RecordingHeader::continued, true, true},
};

/// Stores a member of Sample as it is.
template <auto Member>
struct Plain {
  using Value = std::remove_cvref_t<decltype(std::declval<Sample>().*Member)>;
  static Value get(const Sample& sample) { return sample.*Member; }
  static void set(Sample& sample, const Value& value) { sample.*Member = value; }
};

/// Stores a vector as three numbers.
template <Vec3 Sample::*Member>
struct Vector {
  using Value = std::array<double, 3>;
  static Value get(const Sample& sample) {
    const Vec3& v = sample.*Member;
    return {v.x(), v.y(), v.z()};
  }
  static void set(Sample& sample, const Value& value) { sample.*Member = Vec3(value[0], value[1], value[2]); }
};

/// Stores the gains as six numbers.
struct Gains {
  using Value = std::array<double, 6>;
  static Value get(const Sample& sample) {
    const Vec3 &kp = sample.kp, &kd = sample.kd;
    return {kp.x(), kp.y(), kp.z(), kd.x(), kd.y(), kd.z()};
  }
  static void set(Sample& sample, const Value& value) {
    sample.kp = Vec3(value[0], value[1], value[2]);
    sample.kd = Vec3(value[3], value[4], value[5]);
  }
};

/// Stores time in seconds.
struct Seconds {
  using Value = double;
  static Value get(const Sample& sample) { return static_cast<double>(sample.time_ns) * 1e-9; }
  static void set(Sample& sample, const Value& value) { sample.time_ns = std::llround(value * 1e9); }
};
template <auto Member>
struct Orientation {
  using Value = std::array<double, 4>;
  static Value get(const Sample& sample) {
    const Quat& q = sample.*Member;
    return {q.w(), q.x(), q.y(), q.z()};
  }
  static void set(Sample& sample, const Value& value) { sample.*Member = Quat(value[0], value[1], value[2], value[3]); }
};

template <class Field>
void pack(std::span<const Sample> samples, std::byte* rows) {
  for (const Sample& sample : samples) {
    const typename Field::Value value = Field::get(sample);
    std::memcpy(rows, &value, sizeof value);
    rows += sizeof value;
  }
}

template <class Field>
void unpack(const std::byte* rows, std::span<Sample> samples) {
  for (Sample& sample : samples) {
    typename Field::Value value;
    std::memcpy(&value, rows, sizeof value);
    Field::set(sample, value);
    rows += sizeof value;
  }
}

template <class Value>
constexpr Element element_of() {
  if constexpr (std::is_same_v<Value, float>) return Element::float32;
  if constexpr (std::is_same_v<Value, std::uint64_t>) return Element::uint64;
  if constexpr (std::is_same_v<Value, std::uint32_t>) return Element::uint32;
  if constexpr (sizeof(Value) == 1) return Element::uint8;
  return Element::float64;
}

template <class Field>
constexpr Column column(const char* name, const char* units, const char* description,
                        bool RecordingColumns::*option = nullptr, double Precision::*quantity = nullptr) {
  using Value = typename Field::Value;
  constexpr Element element = element_of<Value>();
  constexpr std::size_t width = element == Element::float64 ? sizeof(Value) / sizeof(double) : 1;
  return {name, element, width, units, description, option, quantity, &pack<Field>, &unpack<Field>};
}

constexpr Column kColumns[] = {
    column<Seconds>("time", "s", "since the first sample, read from the clock"),
    column<Plain<&Sample::tick>>("tick", "1", "index of the servo loop's tick; a gap is a tick that was missed"),
    column<Vector<&Sample::position>>("position", "m", "of the tool tip in the device's base frame: x, y, z", nullptr,
                                      &Precision::position),
    column<Vector<&Sample::velocity>>("velocity", "m/s", "estimate that the controller used: x, y, z", nullptr,
                                      &Precision::velocity),
    column<Vector<&Sample::force>>("force", "N", "on the hand, as sent to the device after all limits: x, y, z",
                                   nullptr, &Precision::force),
    column<Orientation<&Sample::orientation>>("orientation", "1",
                                              "of the tool in the device's base frame, unit quaternion: w, x, y, z",
                                              &RecordingColumns::orientation),
    column<Vector<&Sample::torque>>("torque", "N m", "on the hand, as sent to the device: x, y, z",
                                    &RecordingColumns::torque, &Precision::torque),
    column<Vector<&Sample::force_measured>>("force_measured", "N", "by the device's own sensor: x, y, z",
                                            &RecordingColumns::force_measured, &Precision::force),
    column<Vector<&Sample::support>>("support", "N", "part of `force` that carried the arm: x, y, z",
                                     &RecordingColumns::support, &Precision::force),
    column<Vector<&Sample::reference_position>>("reference_position", "m", "where the tool should be: x, y, z",
                                                &RecordingColumns::reference, &Precision::position),
    column<Vector<&Sample::reference_velocity>>("reference_velocity", "m/s", "how the tool should move: x, y, z",
                                                &RecordingColumns::reference, &Precision::velocity),
    column<Orientation<&Sample::reference_orientation>>("reference_orientation", "1",
                                                        "how the tool should point, unit quaternion: w, x, y, z",
                                                        &RecordingColumns::reference_orientation),
    column<Vector<&Sample::reference_force>>("reference_force", "N",
                                             "the expert's force at the present point of the path: x, y, z",
                                             &RecordingColumns::guidance, &Precision::force),
    column<Plain<&Sample::progress>>("progress", "m", "arc length of the projection on the expert's path",
                                     &RecordingColumns::guidance, &Precision::position),
    column<Plain<&Sample::tunnel_radius>>("tunnel_radius", "m", "of the tunnel at the projection",
                                          &RecordingColumns::tunnel, &Precision::position),
    column<Gains>("gains", "N/m, N s/m",
                  "of the feedback in force, after softening and limits: kp x, y, z, then kd x, y, z",
                  &RecordingColumns::gains),
    column<Plain<&Sample::buttons>>("buttons", "1", "pressed buttons, one bit each"),
    column<Plain<&Sample::phase>>("phase", "1", "0 idle, 1 approach, 2 run, 3 hold, 4 release, 5 stopped by a limit"),
    column<Plain<&Sample::latency>>("latency", "s", "wake-up time minus deadline"),
};

/// Field of one number. Integers and booleans are uint64 in the file.
template <auto Member>
constexpr OverviewField number(const char* name) {
  using Value = std::remove_cvref_t<decltype(std::declval<RecordingSummary>().*Member)>;
  using Stored = std::conditional_t<std::is_floating_point_v<Value>, double, std::uint64_t>;
  return {name, std::is_floating_point_v<Value>, 1,
          [](const RecordingSummary& summary, std::byte* field) {
            const auto value = static_cast<Stored>(summary.*Member);
            std::memcpy(field, &value, sizeof value);
          },
          [](const std::byte* field, RecordingSummary& summary) {
            Stored value;
            std::memcpy(&value, field, sizeof value);
            summary.*Member = static_cast<Value>(value);
          }};
}

/// Field of a vector of three. `Of` returns it from a summary, const or not.
template <auto Of>
constexpr OverviewField vector(const char* name) {
  return {name, true, 3,
          [](const RecordingSummary& summary, std::byte* field) {
            std::memcpy(field, Of(summary).data(), 3 * sizeof(double));
          },
          [](const std::byte* field, RecordingSummary& summary) {
            std::memcpy(Of(summary).data(), field, 3 * sizeof(double));
          }};
}

constexpr OverviewField kOverviewFields[] = {
    number<&RecordingSummary::rows>("rows"), number<&RecordingSummary::first_ns>("first_time_ns"),
    number<&RecordingSummary::last_ns>("last_time_ns"), number<&RecordingSummary::first_tick>("first_tick"),
    number<&RecordingSummary::last_tick>("last_tick"), vector < [](auto& s) -> auto& {return s.first_position;
}  // namespace
> ("first_position"), vector < [](auto& s) -> auto& {
  return s.last_position;
}
> ("last_position"), number<&RecordingSummary::gaps>("gaps"), number<&RecordingSummary::missed>("missed"),
    number<&RecordingSummary::longest_interval>("longest_interval"), vector < [](auto& s) -> auto& {
  return s.bounds.min;
}
> ("position_min"), vector < [](auto& s) -> auto& {
  return s.bounds.max;
}
> ("position_max"), number<&RecordingSummary::path_length>("path_length"),
    number<&RecordingSummary::peak_speed>("peak_speed"), number<&RecordingSummary::max_force>("max_force"),
    number<&RecordingSummary::with_velocity>("with_velocity"), number<&RecordingSummary::with_force>("with_force"),
    number<&RecordingSummary::without_position>("without_position"), number<&RecordingSummary::runs>("runs"),
    number<&RecordingSummary::run_rows>("run_rows"), number<&RecordingSummary::begins_in_run>("begins_in_run"),
    number<&RecordingSummary::ends_in_run>("ends_in_run"), vector < [](auto& s) -> auto& {
  return s.run_bounds.min;
}
> ("run_position_min"), vector < [](auto& s) -> auto& {
  return s.run_bounds.max;
}
> ("run_position_max"), number<&RecordingSummary::run_peak_speed>("run_peak_speed"),
    number<&RecordingSummary::tracked>("tracked"), number<&RecordingSummary::error2_sum>("squared_error_sum"),
    number<&RecordingSummary::error2_peak>("squared_error_peak"),
};  // namespace layout

}  // namespace haptrace
}  // namespace layout

double clock_drift(std::span<const ClockReading> readings) {
  if (readings.size() < 2) return kNaN;
  // Fits a line by least squares, relative to the first reading, so that the numbers stay small.
  const ClockReading& first = readings.front();
  double xx = 0, xy = 0;
  double mean_x = 0, mean_y = 0;
  const auto x = [&](const ClockReading& r) { return static_cast<double>(r.monotonic_ns - first.monotonic_ns); };
  const auto y = [&](const ClockReading& r) { return static_cast<double>(r.realtime_ns - first.realtime_ns) - x(r); };
  for (const ClockReading& reading : readings) {
    mean_x += x(reading) / static_cast<double>(readings.size());
    mean_y += y(reading) / static_cast<double>(readings.size());
  }
  for (const ClockReading& reading : readings) {
    xx += (x(reading) - mean_x) * (x(reading) - mean_x);
    xy += (x(reading) - mean_x) * (y(reading) - mean_y);
  }
  return xx > 0 ? xy / xx : kNaN;
}

std::size_t row_bytes(const RecordingColumns& columns) {
  std::size_t bytes = 0;
  for (const layout::Column& column : layout::columns())
    if (column.in(columns)) bytes += column.row_bytes();
  return bytes;
}

namespace layout {

std::span<const OverviewField> overview_fields() {
  return kOverviewFields;
}

std::string warnings_text(const nlohmann::json& warnings) {
  struct Entry {
    std::string text;
    bool is_note;
  };
  std::vector<Entry> kept;
  std::size_t bytes = 2;  // of the list's brackets
  for (const nlohmann::json& warning : warnings.is_array() ? warnings : nlohmann::json::array()) {
    kept.push_back({warning.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace),
                    warning.is_object() && warning.value("severity", "") == to_string(Severity::note)});
    bytes += kept.back().text.size() + 1;
  }
  // The last notes go first, then the last warnings.
  for (const bool notes : {true, false})
    for (std::size_t i = kept.size(); i-- > 0 && bytes > kWarningBytes;)
      if (kept[i].is_note == notes) {
        bytes -= kept[i].text.size() + 1;
        kept[i].text.clear();
      }
  std::string text = "[";
  for (const Entry& entry : kept)
    if (!entry.text.empty()) text += (text.size() > 1 ? "," : "") + entry.text;
  return text + "]";
}

std::span<const Attribute> attributes() {
  return kAttributes;
}

std::span<const Column> columns() {
  return kColumns;
}

std::size_t size_of(Element element) {
  switch (element) {
    case Element::float64:
    case Element::uint64:
      return 8;
    case Element::float32:
    case Element::uint32:
      return 4;
    case Element::uint8:
      return 1;
  }
  return 0;
}

const char* to_string(Element element) {
  static constexpr EnumNames<Element, 5> kElements{"element", {"float64", "float32", "uint64", "uint32", "uint8"}};
  return kElements.name(element);
}

std::array<std::byte, ContactRow::kBytes> pack(const ContactSample& contact) {
  std::array<std::byte, ContactRow::kBytes> row{};
  const double time = 1e-9 * static_cast<double>(contact.time_ns);
  const auto put = [&](std::size_t at, const auto& value, std::size_t bytes) { std::memcpy(&row[at], &value, bytes); };
  put(ContactRow::kTime, time, sizeof time);
  put(ContactRow::kTick, contact.tick, sizeof contact.tick);
  put(ContactRow::kObject, contact.object, sizeof contact.object);
  put(ContactRow::kProxy, *contact.proxy.data(), 3 * sizeof(double));
  put(ContactRow::kNormal, *contact.normal.data(), 3 * sizeof(double));
  put(ContactRow::kDepth, contact.depth, sizeof contact.depth);
  put(ContactRow::kForce, *contact.force.data(), 3 * sizeof(double));
  return row;
}

ContactSample unpack_contact(const std::byte* row) {
  ContactSample contact;
  double time = 0;
  std::memcpy(&time, row + ContactRow::kTime, sizeof time);
  contact.time_ns = std::abs(time) < kLongestTime ? std::llround(1e9 * time) : 0;
  std::memcpy(&contact.tick, row + ContactRow::kTick, sizeof contact.tick);
  std::memcpy(&contact.object, row + ContactRow::kObject, sizeof contact.object);
  std::memcpy(contact.proxy.data(), row + ContactRow::kProxy, 3 * sizeof(double));
  std::memcpy(contact.normal.data(), row + ContactRow::kNormal, 3 * sizeof(double));
  std::memcpy(&contact.depth, row + ContactRow::kDepth, sizeof contact.depth);
  std::memcpy(contact.force.data(), row + ContactRow::kForce, 3 * sizeof(double));
  return contact;
}

std::vector<std::string> paths() {
  std::vector<std::string> paths{kMeta, kScene, kContacts, kEvents, kOverview, kChecksums, kClocks, kEventList};
  for (const EventColumn& column : kEventColumns) paths.emplace_back(column.path);
  for (const Column& column : columns()) paths.push_back(column.path());
  return paths;
}

bool has_grid(std::string_view format_version) {
  const std::size_t point = format_version.find('.');
  if (point == std::string_view::npos) return false;
  std::string_view minor = format_version.substr(point + 1);
  return take_number<int>(minor).value_or(0) >= 1;
}

DecimalGrid::DecimalGrid(int digits) : digits_(digits), scale_(std::pow(10.0, digits)) {}

DecimalGrid DecimalGrid::within(double bound) {
  return DecimalGrid(static_cast<int>(std::ceil(std::log10(0.5 / bound) + 1e-9)));
}

void DecimalGrid::snap(std::span<std::byte> values) const noexcept {
  for (std::size_t at = 0; at + sizeof(double) <= values.size(); at += sizeof(double)) {
    double value = 0;
    std::memcpy(&value, values.data() + at, sizeof value);
    value = snap(value);
    std::memcpy(values.data() + at, &value, sizeof value);
  }
}

namespace {

std::uint64_t known(std::uint64_t hash) {
  return hash == 0 ? 1 : hash;
}

}  // namespace

std::uint64_t checksum(std::span<const std::byte> bytes) {
  return known(XXH3_64bits(bytes.data(), bytes.size()));
}

void Checksum::Free::operator()(void* state) const noexcept {
  XXH3_freeState(static_cast<XXH3_state_t*>(state));
}

Checksum::Checksum() : state_(XXH3_createState()) {
  if (!state_) throw std::bad_alloc();
  XXH3_64bits_reset(static_cast<XXH3_state_t*>(state_.get()));
}

void Checksum::add(std::span<const std::byte> bytes) {
  XXH3_64bits_update(static_cast<XXH3_state_t*>(state_.get()), bytes.data(), bytes.size());
}

std::uint64_t Checksum::take() {
  auto* state = static_cast<XXH3_state_t*>(state_.get());
  const std::uint64_t hash = known(XXH3_64bits_digest(state));
  XXH3_64bits_reset(state);
  return hash;
}

ClockRow pack(const ClockReading& reading) {
  ClockRow row{reading.time_ns, reading.realtime_ns, reading.monotonic_ns, reading.uncertainty_ns, 0};
  row.back() = static_cast<std::int64_t>(checksum(std::as_bytes(std::span(row).first(4))));
  return row;
}

std::optional<ClockReading> unpack(const ClockRow& row) {
  if (static_cast<std::int64_t>(checksum(std::as_bytes(std::span(row).first(4)))) != row.back()) return std::nullopt;
  return ClockReading{row[0], row[1], row[2], row[3]};
}

}  // namespace layout
}  // namespace haptrace
