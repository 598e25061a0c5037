// The recording file: HDF5, format_version "1.1". Its layout is in docs/file-format.md and nowhere else.
#pragma once

#include "control/warning.h"
#include "formats/recording/recording_summary.h"
#include "formats/recording/storage.h"

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// The attributes of a recording's root.
struct RecordingHeader {
  std::string format_version = "1.1";
  std::string uuid;     ///< made by create() when empty
  std::string created;  ///< RFC 3339, UTC; made by create() when empty
  std::string software;
  std::string title, subject, operator_name, notes;
  double rate_hz = 1000;
  std::string clock = "monotonic";  ///< "monotonic" | "virtual"
  bool complete = false;
  nlohmann::json config = nlohmann::json::object();  ///< the session's whole JSON
  std::string device_name, device_model, device_serial, device_backend;
  double position_resolution_m = 0;
  double max_force_n = 0;

  /// The session's warnings, known once it ended: see json_of(warnings) in formats/documents/warning_json.h.
  nlohmann::json warnings = nlohmann::json::array();

  std::map<std::string, std::string> meta;  ///< what else the experimenter wants to keep, by key

  /// Of a recording in several files: which one this is, from 1, and the uuid of the first. 0: it is whole.
  std::uint32_t part = 0;
  std::string part_of;
  bool continued = false;  ///< a further part was begun after this one
};

/// What two clocks of the computer said at one moment: it aligns a recording with video, EMG or a lab's network.
struct ClockReading {
  std::int64_t time_ns = 0;         ///< of the recording
  std::int64_t realtime_ns = 0;     ///< CLOCK_REALTIME: since 1970-01-01T00:00:00Z
  std::int64_t monotonic_ns = 0;    ///< CLOCK_MONOTONIC
  std::int64_t uncertainty_ns = 0;  ///< the three are of moments at most this far apart
};

/// How much faster the wall clock ran than the monotonic one over `readings`, in parts; NaN for fewer than two.
double clock_drift(std::span<const ClockReading> readings);

/// The file of part `part` of the recording `file`: part 1 is the file itself, others have .part002 before the ending.
std::string part_file(const std::string& file, std::uint32_t part);

/// Which of the optional columns of /samples a recording has. The others are always there.
struct RecordingColumns {
  bool orientation = false;
  bool torque = false;
  bool force_measured = false;
  bool reference = false;  ///< reference_position and reference_velocity
  bool guidance = false;   ///< reference_force and progress
  bool tunnel = false;     ///< tunnel_radius
  bool reference_orientation = false;
};

/// Bytes of a row that is stored as it lies in memory.
std::size_t row_bytes(const RecordingColumns& columns);

inline constexpr std::size_t kLongestEventText = 127;  ///< [bytes] of UTF-8

/// An event as a file keeps it.
struct StoredEvent {
  double time = 0;  ///< [s] since the first sample
  std::int32_t code = 0;
  std::string text;
};

/// Writes one recording. Readers can follow it live (SWMR); what was flushed survives the death of the process.
///
/// Threads: one thread at a time; not the servo thread, since every call does I/O.
class RecordingWriter {
 public:
  struct Options {
    bool overwrite = false;
    Storage storage;
    /// Readers cannot follow such a file live, but programs with HDF5 1.8 open it (MATLAB before R2021b).
    bool for_hdf5_1_8 = false;
    /// The recording may go on in further files, see start_part(). The names of those must be free as well.
    bool in_parts = false;
    /// The header's part and part_of are kept: the file takes the place of one part of a recording.
    bool keep_part = false;
  };

  /// Creates `file` under its final name with every dataset and attribute, and starts SWMR. A file that is replaced
  /// stays as it was until its successor is ready; nothing is left behind when that fails.
  /// Throws Error(input) when the file exists (unless `overwrite`), its folder is missing or not writable, an option is
  /// out of range, or a text of the header, the config included, is longer than 60 000 bytes.
  RecordingWriter(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
                  const Options& options);
  ~RecordingWriter();  ///< abandons what was not finished
  RecordingWriter(RecordingWriter&&) noexcept;
  RecordingWriter& operator=(RecordingWriter&&) noexcept;

  /// Appends rows in order. Throws Error(fault) when the disk refuses; what was flushed before stays readable, and
  /// every later append, flush and finish throws the same error.
  void append(std::span<const Sample> samples);
  /// A text beyond kLongestEventText is cut after a whole character and ends in "...".
  void append(const StoredEvent& event);
  void append(const ClockReading& reading);

  /// Makes everything appended so far visible to readers and safe from the death of this process; of filtered storage,
  /// whole chunks only.
  void flush();

  /// Flushes, and waits until the disk has it all: safe from the death of the machine.
  void sync();

  /// Goes on in the next part, and finishes this file once that is there. Throws like append; also Error(input) unless
  /// `in_parts`.
  void start_part();

  /// After a failure: goes on in the next part, which takes over the rows that memory still has and the broken file has
  /// not. Answers how many rows are in neither. Throws Error(fault) when that cannot be made yet; call it again then.
  std::uint64_t resume();

  /// Replaces the header's warnings; what does not fit into kWarningBytes is left out, notes first. Throws like append.
  void warn(const nlohmann::json& warnings);

  /// Flushes, marks the recording complete and closes it. Throws like append.
  void finish();

  /// Closes without marking it complete, keeping everything that was appended and fits on the disk. Never throws.
  void abandon() noexcept;

  [[nodiscard]] std::uint64_t rows() const noexcept;       ///< of all parts; after a failure, those in the files
  [[nodiscard]] std::uint64_t part_rows() const noexcept;  ///< of the present one

  /// The largest size that the present file can have when it is closed with `more` further rows.
  [[nodiscard]] std::uint64_t part_bytes(std::size_t more) const;

  /// The file that is being written: the present part.
  [[nodiscard]] const std::string& part() const noexcept;

  /// What became of the present file's name: empty while it leads to this file, else what to know about it.
  [[nodiscard]] std::string misplaced() const;

 private:
  class File;
  [[nodiscard]] RecordingHeader header_of_next() const;
  void go_on(RecordingHeader header, std::unique_ptr<File> next);
  static void remove_empty(std::unique_ptr<File>& part);

  RecordingHeader header_;
  RecordingColumns columns_;
  Options options_;
  std::string name_;
  std::uint64_t rows_before_ = 0;  ///< in the parts before
  std::unique_ptr<File> file_;
};

/// Reads one recording, finished or not, without changing it. Files of other writers that keep the layout are read
/// whatever the precision, storage and filters of their datasets. Opening costs the same at any length.
///
/// The first file of a recording in parts opens all of them, read as one; another opens that part alone.
///
/// Who reads the rows in order has them compared with the checksums that the file keeps, block by block.
///
/// Threads: one thread at a time.
class RecordingReader {
 public:
  /// Which of a recording's files are read: all, and none may be missing; those that are there; the one alone.
  enum class Parts { all, present, this_file };

  /// Throws Error(input): missing file or part, not HDF5, HDF5 that is something else, a newer format, missing
  /// datasets.
  explicit RecordingReader(const std::string& file, Parts which = Parts::all);

  /// Opens as much of a damaged file as can be opened, for salvage(); what cannot is in lost(). Throws like the
  /// constructor when it is nothing that could be a recording.
  static RecordingReader for_salvage(const std::string& file, Parts which = Parts::this_file);
  ~RecordingReader();
  RecordingReader(RecordingReader&&) noexcept;
  RecordingReader& operator=(RecordingReader&&) noexcept;

  [[nodiscard]] RecordingHeader header() const;  ///< of the first part; complete and warnings are the last one's
  [[nodiscard]] const RecordingColumns& columns() const noexcept;

  /// Rows that every dataset has (after a crash, the shortest), up to the last that has a time; of all parts.
  [[nodiscard]] std::uint64_t rows() const noexcept;

  /// Takes notice of what a writer in another process has flushed since: rows, events and whether it is complete.
  void refresh();

  /// Values that are not those that were recorded, or cannot be read.
  struct Damage {
    std::string file, path;              ///< of the dataset
    std::uint64_t first = 0, count = 0;  ///< rows of the file
    std::string what;
    bool readable = true;  ///< values are there, but some are not those that were recorded
  };
  /// Has damage told that checksums find, instead of thrown, and what salvage() cannot read.
  void on_damage(std::function<void(const Damage&)> told);

  /// Reads rows [first, first + count), fewer at the end. Absent columns are NaN. Throws Error(input) on damage, naming
  /// the dataset and, where it is one, the row.
  [[nodiscard]] std::vector<Sample> read(std::uint64_t first, std::uint64_t count) const;

  /// The same of some columns only; the others are as in Sample{}. `names` are those of the datasets.
  [[nodiscard]] std::vector<Sample> read(std::uint64_t first, std::uint64_t count,
                                         std::span<const std::string_view> names) const;

  /// The same column by column: values that cannot be read are as in Sample{} and are told to on_damage(); for_salvage.
  [[nodiscard]] std::vector<Sample> salvage(std::uint64_t first, std::uint64_t count) const;

  [[nodiscard]] const std::vector<std::string>& lost() const noexcept;  ///< what for_salvage could not open, in words
  [[nodiscard]] std::vector<std::string> foreign() const;               ///< datasets and attributes of other programs
  [[nodiscard]] std::uint64_t checksum_rows() const noexcept;  ///< for each of which the first part has checksums, or 1

  [[nodiscard]] std::vector<StoredEvent> events() const;
  [[nodiscard]] std::vector<ClockReading> clocks() const;  ///< of the file, or of all parts; none in older files

  /// Figures of consecutive blocks that make up all rows. As the file keeps them, which takes milliseconds at any
  /// length; what it does not keep is read, and told to `progress` as rows done.
  [[nodiscard]] std::vector<RecordingSummary> overview(const std::function<void(std::uint64_t)>& progress = {}) const;

  /// The last row whose time is at most `time_ns`; 0 when there is none. Costs O(log rows). The recording has rows.
  [[nodiscard]] std::uint64_t row_at(std::int64_t time_ns) const;

  [[nodiscard]] std::uint32_t parts() const noexcept;                            ///< files that were opened
  [[nodiscard]] std::vector<std::string> files() const;                          ///< their names
  [[nodiscard]] const std::vector<std::string>& missing_parts() const noexcept;  ///< files that should be there
  [[nodiscard]] int deflate() const;  ///< level at which positions are packed; 0: they are not

 private:
  class Part;
  RecordingReader(const std::string& file, Parts which, bool salvages);
  void open_further_parts();
  [[nodiscard]] std::unique_ptr<Part> open_part(const std::string& file, std::uint32_t number,
                                                const std::string& origin);
  [[nodiscard]] bool later_part(std::uint32_t number, const std::string& origin) const;

  /// Has `read` fill the rows that it is given, from row `first` of its part on.
  [[nodiscard]] std::vector<Sample> read_parts(
      std::uint64_t first, std::uint64_t count,
      const std::function<void(const Part&, std::uint64_t first, std::span<Sample>)>& read) const;

  Parts which_;
  bool salvages_ = false;
  std::vector<std::unique_ptr<Part>> parts_;
  std::vector<std::string> missing_, lost_;
  std::function<void(const Damage&)> told_;
};

/// Calls `visit` with consecutive blocks of rows: memory stays flat in the length of the recording.
void for_each_block(const RecordingReader& reader, const std::function<void(std::span<const Sample>)>& visit);

/// One thing that a recording does not keep of docs/file-format.md.
struct Finding {
  using Severity = Warning::Severity;
  Severity severity = Severity::error;
  std::string where;  ///< the object or row, for example "/samples/time[120]"
  std::string what;
};

/// Validates a file against the format, and all its parts where it is the first; empty when it keeps all of it. A part
/// that is missing is an error, or a warning when the recording is known to be `partial`.
/// Streams: memory is flat in the file's length. `progress` is told the part of the rows that is done, 0 to 1.
/// Throws Error(input) only when the file cannot be read at all.
std::vector<Finding> check_recording(const std::string& file, const std::function<void(double)>& progress = {},
                                     bool partial = false);

/// True when the file begins like HDF5.
bool is_hdf5(const std::string& file);

}  // namespace haptrace
