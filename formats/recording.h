// The recording file: HDF5, format_version "1.0". Its layout is in docs/file-format.md and nowhere else.
#pragma once

#include "control/warning.h"
#include "formats/recording_summary.h"
#include "formats/storage.h"

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
  std::string format_version = "1.0";
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

  /// The session's warnings, known once it ended: see json_of(warnings) in formats/warning_json.h.
  nlohmann::json warnings = nlohmann::json::array();

  std::map<std::string, std::string> meta;  ///< what else the experimenter wants to keep, by key

  /// Of a recording in several files: which one this is, from 1, and the uuid of the first. 0: it is whole.
  std::uint32_t part = 0;
  std::string part_of;
};

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
  void append(const StoredEvent& event);  ///< text beyond 127 bytes is cut after a whole character

  /// Makes everything appended so far visible to readers and safe from the death of this process; of filtered storage,
  /// whole chunks only.
  void flush();

  /// Flushes, and waits until the disk has it all: safe from the death of the machine.
  void sync();

  /// Finishes this file and goes on in the next part. Throws like append; also Error(input) unless `in_parts`.
  void start_part();

  /// Replaces the header's warnings; what does not fit into kWarningBytes is left out, notes first. Throws like append.
  void warn(const nlohmann::json& warnings);

  /// Flushes, marks the recording complete and closes it. Throws like append.
  void finish();

  /// Closes without marking it complete, keeping everything that was appended and fits on the disk. Never throws.
  void abandon() noexcept;

  [[nodiscard]] std::uint64_t rows() const noexcept;       ///< of all parts
  [[nodiscard]] std::uint64_t part_rows() const noexcept;  ///< of the present one
  [[nodiscard]] std::uint64_t part_bytes() const;          ///< size of the present file

  /// The file that is being written: the present part.
  [[nodiscard]] const std::string& part() const noexcept;

  /// What became of the present file's name: empty while it leads to this file, else what to know about it.
  [[nodiscard]] std::string misplaced() const;

 private:
  class File;
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
/// Threads: one thread at a time.
class RecordingReader {
 public:
  /// Which of a recording's files are read.
  enum class Parts { all, this_file };

  /// Throws Error(input): missing file, not HDF5, HDF5 that is something else, a newer format, missing datasets.
  explicit RecordingReader(const std::string& file, Parts which = Parts::all);
  ~RecordingReader();
  RecordingReader(RecordingReader&&) noexcept;
  RecordingReader& operator=(RecordingReader&&) noexcept;

  [[nodiscard]] RecordingHeader header() const;  ///< of the first part; complete and warnings are the last one's
  [[nodiscard]] const RecordingColumns& columns() const noexcept;

  /// Rows that every dataset has (after a crash, the shortest), up to the last that has a time; of all parts.
  [[nodiscard]] std::uint64_t rows() const noexcept;

  /// Takes notice of what a writer in another process has flushed since: rows, events and whether it is complete.
  void refresh();

  /// Reads rows [first, first + count), fewer at the end. Absent columns are NaN. Throws Error(input) on damage, naming
  /// the dataset and, where it is one, the row.
  [[nodiscard]] std::vector<Sample> read(std::uint64_t first, std::uint64_t count) const;

  /// The same of some columns only; the others are as in Sample{}. `names` are those of the datasets.
  [[nodiscard]] std::vector<Sample> read(std::uint64_t first, std::uint64_t count,
                                         std::span<const std::string_view> names) const;

  [[nodiscard]] std::vector<StoredEvent> events() const;

  /// Figures of consecutive blocks that make up all rows. As the file keeps them, which takes milliseconds at any
  /// length; what it does not keep is read, and told to `progress` as rows done.
  [[nodiscard]] std::vector<RecordingSummary> overview(const std::function<void(std::uint64_t)>& progress = {}) const;

  /// The last row whose time is at most `time_ns`; 0 when there is none. Costs O(log rows). The recording has rows.
  [[nodiscard]] std::uint64_t row_at(std::int64_t time_ns) const;

  [[nodiscard]] std::uint32_t parts() const noexcept;  ///< files that were opened
  [[nodiscard]] int deflate() const;                   ///< level at which positions are packed; 0: they are not

 private:
  void open_further_parts();

  class Part;
  Parts which_;
  std::vector<std::unique_ptr<Part>> parts_;
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

/// Validates a file against the format, and all its parts where it is the first; empty when it keeps all of it.
/// Streams: memory is flat in the file's length. `progress` is told the part of the rows that is done, 0 to 1.
/// Throws Error(input) only when the file cannot be read at all.
std::vector<Finding> check_recording(const std::string& file, const std::function<void(double)>& progress = {});

/// True when the file begins like HDF5.
bool is_hdf5(const std::string& file);

}  // namespace haptrace
