// Layout of a recording, stated once: writer, reader and check all use these tables. Private to formats.
#pragma once

#include "formats/recording/recording.h"
#include "formats/recording/recording_summary.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>

namespace haptrace::layout {

inline constexpr std::string_view kFormat = "haptrace-recording";
inline constexpr int kMajorVersion = 1;

/// Returns true from version 1.1 on, in which rounded values lie on a DecimalGrid.
bool has_grid(std::string_view format_version);

/// HDF5 stores an attribute of fixed size in the object header, whose messages end at 64 KiB.
inline constexpr std::size_t kLongestText = 60'000;  // [bytes]

/// Longer times do not fit into the 63 bits of nanoseconds of a Sample.
inline constexpr double kLongestTime = 9.2e9;  // [s]

/// A root attribute and its member of the header. The root also has `format`, always kFormat.
struct Attribute {
  const char* name;
  std::variant<std::string RecordingHeader::*, double RecordingHeader::*, bool RecordingHeader::*,
               std::uint32_t RecordingHeader::*, nlohmann::json RecordingHeader::*>
      member;
  bool of_parts = false;  ///< only a recording in parts has it
  bool optional = false;  ///< files of earlier versions lack it
};
std::span<const Attribute> attributes();

inline constexpr const char* kContinued = "continued";

/// Attribute that receives its text when the session has ended, and its size [bytes]. With its header it fills one
/// page, since it changes while others read.
inline constexpr const char* kWarnings = "warnings";
inline constexpr std::size_t kWarningBytes = 3840;

/// Returns JSON of as many `warnings` as fit into kWarningBytes with a final zero. Omits notes first, then the last
/// ones.
std::string warnings_text(const nlohmann::json& warnings);

/// Types of a dataset's elements; little-endian in the file.
enum class Element { float64, float32, uint64, uint32, uint8 };

std::size_t size_of(Element element);
const char* to_string(Element element);
inline bool is_float(Element element) {
  return element == Element::float64 || element == Element::float32;
}

/// A dataset of /samples. Its first dimension is the sample; if `width` > 1, the second is the component.
struct Column {
  const char* name;
  Element element;
  std::size_t width;
  const char* units;
  const char* description;
  bool RecordingColumns::*option;  ///< option that includes it; null if every recording has it
  double Precision::*quantity;     ///< bound of its rounding; null: never rounded
  void (*pack)(std::span<const Sample> samples, std::byte* rows);    ///< samples -> rows of the file
  void (*unpack)(const std::byte* rows, std::span<Sample> samples);  ///< rows of the file -> samples

  [[nodiscard]] std::size_t row_bytes() const { return width * size_of(element); }
  [[nodiscard]] bool in(const RecordingColumns& columns) const { return option == nullptr || columns.*option; }
  [[nodiscard]] std::string path() const { return std::string("/samples/") + name; }
};

/// Returns all columns; time is the first.
std::span<const Column> columns();

/// Returns the paths of all datasets and groups that a recording can have.
std::vector<std::string> paths();

/// Byte layout of a row of /events, a compound type.
struct EventRow {
  static constexpr std::size_t kTextBytes = kLongestEventText + 1;  ///< including the final zero
  static constexpr std::size_t kTime = 0, kCode = 8, kText = 12, kBytes = kText + kTextBytes;
};
inline constexpr const char* kEvents = "/events";
inline constexpr const char* kEventUnits = "time: s";

/// A member of /events as a separate dataset, for programs that cannot read compounds. haptrace's own readers do not
/// need this copy.
struct EventColumn {
  const char* path;
  std::size_t offset, bytes;  ///< position in an EventRow
  const char* units;
};
inline constexpr const char* kEventList = "/event_list";
inline constexpr std::array<EventColumn, 3> kEventColumns{
    {{"/event_list/time", EventRow::kTime, 8, "s"},
     {"/event_list/code", EventRow::kCode, 4, "1"},
     {"/event_list/text", EventRow::kText, EventRow::kTextBytes, "1"}}};
inline constexpr const char* kEventListDescription = "the same as in /events, for programs that read no compounds";

/// Byte layout of a row of /contacts, a compound type.
struct ContactRow {
  static constexpr std::size_t kTime = 0, kTick = 8, kObject = 16, kProxy = 20, kNormal = 44, kDepth = 68, kForce = 76,
                               kBytes = 100;
};
inline constexpr const char* kContacts = "/contacts";
inline constexpr const char* kContactUnits = "time: s, proxy: m, depth: m, force: N";
inline constexpr const char* kContactDescription =
    "contacts with the objects of the scene, one row per tick and object: index of the object from 0, where its "
    "surface holds the tool back, normal out of it, depth of the tool behind that place, force of the object alone";
std::array<std::byte, ContactRow::kBytes> pack(const ContactSample& contact);
ContactSample unpack_contact(const std::byte* row);
inline constexpr const char* kContactsChecksum = "contacts_checksum";

/// Group that describes the scene of a session: attributes with the scene file's text and the names of its objects, and
/// one for each file that the scene names, with that file's hash.
inline constexpr const char* kScene = "/scene";
inline constexpr const char* kSceneText = "text";
inline constexpr const char* kSceneObjects = "objects";
inline constexpr const char* kSceneFolder = "folder";
inline constexpr const char* kSceneFile = "file:";  ///< prefix of the attribute of a file

/// A field of a row of /overview and its member of RecordingSummary: one or three numbers of 8 bytes.
struct OverviewField {
  const char* name;
  bool floating;      ///< float64, otherwise uint64
  std::size_t width;  ///< 1 or 3
  void (*pack)(const RecordingSummary& summary, std::byte* field);
  void (*unpack)(const std::byte* field, RecordingSummary& summary);

  [[nodiscard]] std::size_t bytes() const { return 8 * width; }
};
std::span<const OverviewField> overview_fields();
inline constexpr const char* kOverview = "/overview";
inline constexpr const char* kOverviewUnits = "SI";
inline constexpr const char* kOverviewDescription =
    "statistics of consecutive blocks of rows, to summarise a recording without reading the rows; may lag behind";
inline constexpr std::uint64_t kOverviewRows = 8192;  ///< per block, except the last

/// XXH3 (64 bits) of the bytes of each column in each block of rows; 0: unknown. uint64 [blocks, columns].
inline constexpr const char* kChecksums = "/checksums";
inline constexpr const char* kChecksumUnits = "1";
inline constexpr const char* kChecksumDescription =
    "XXH3 of every block of rows of every column: little-endian bytes as they are read; 0 where not known";
inline constexpr const char* kChecksumRows = "rows";        ///< attribute: rows per block, except the last
inline constexpr const char* kChecksumColumns = "columns";  ///< attribute: names of datasets, in order, with commas
/// Root attributes: checksum of all rows of the dataset; 0 until the recording is closed.
inline constexpr const char* kEventsChecksum = "events_checksum";
inline constexpr const char* kOverviewChecksum = "overview_checksum";

/// Readings of the computer's clocks: int64 [readings, 5], the members of a ClockReading in order, then XXH3 of these
/// four.
inline constexpr const char* kClocks = "/clocks";
inline constexpr const char* kClockUnits = "ns";
inline constexpr const char* kClockDescription =
    "readings of the computer clocks: time of the recording, CLOCK_REALTIME, CLOCK_MONOTONIC, uncertainty, XXH3 of "
    "these four";
using ClockRow = std::array<std::int64_t, 5>;
ClockRow pack(const ClockReading& reading);
std::optional<ClockReading> unpack(const ClockRow& row);  ///< nothing if the checksum differs

/// Computes XXH3 of data piece by piece. It is never 0.
class Checksum {
 public:
  Checksum();
  void add(std::span<const std::byte> bytes);
  [[nodiscard]] std::uint64_t take();  ///< returns the checksum and resets

 private:
  struct Free {
    void operator()(void* state) const noexcept;
  };
  std::unique_ptr<void, Free> state_;
};
std::uint64_t checksum(std::span<const std::byte> bytes);

/// Decimal grid to which HDF5's scale-offset filter rounds. A value that is put on the grid before it is stored comes
/// back bit for bit if it is put on the grid again after reading.
class DecimalGrid {
 public:
  explicit DecimalGrid(int digits);
  static DecimalGrid within(double bound);  ///< coarsest grid with errors of at most `bound`

  [[nodiscard]] int digits() const noexcept { return digits_; }
  [[nodiscard]] double step() const noexcept { return 1 / scale_; }

  /// Returns true if the filter can hold the value: it is finite and not too many steps from zero.
  [[nodiscard]] bool holds(double value) const noexcept { return std::abs(value) * scale_ < kMostSteps; }

  /// Returns the nearest grid value, or the value itself if the filter cannot hold it.
  [[nodiscard]] double snap(double value) const noexcept {
    return holds(value) ? std::nearbyint(value * scale_) / scale_ + 0.0 : value;  // the grid has no -0
  }
  void snap(std::span<std::byte> values) const noexcept;  ///< for float64

 private:
  static constexpr double kMostSteps = 0x1p48;  // well within the 53 bits of a double, in which HDF5 computes
  int digits_;
  double scale_;
};

/// Group for the experimenter's own attributes, all of them text.
inline constexpr const char* kMeta = "/meta";

inline constexpr const char* kEventDescription =
    "session event: time since the first sample, code (10 overrun, 11 samples lost, 20 to 24 limits, 50 mark), text";

}  // namespace haptrace::layout
