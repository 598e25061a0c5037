// The recording file: HDF5, format_version "1.0". Its layout is in docs/file-format.md and nowhere else.
#pragma once

#include "control/sample.h"

#include <cstddef>
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
};

/// Which of the optional columns of /samples a recording has. The others are always there.
struct RecordingColumns {
  bool orientation = false;
  bool torque = false;
  bool force_measured = false;
  bool reference = false;  ///< reference_position and reference_velocity
  bool guidance = false;   ///< reference_force and progress
};

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
    /// Rows that are written at once. Large chunks cost less per row; a flush in between writes the last one again. At
    /// 2048 a row costs no more than 1.2 times a raw write of its bytes.
    std::size_t rows_per_chunk = 2048;
  };

  /// Creates `file` under its final name with every dataset and attribute, and starts SWMR. A file that is replaced
  /// stays as it was until its successor is ready; nothing is left behind when that fails.
  /// Throws Error(input) when the file exists (unless `overwrite`), its folder is missing or not writable, or a text of
  /// the header, the config included, is longer than 60 000 bytes.
  RecordingWriter(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
                  const Options& options);
  ~RecordingWriter();  ///< abandons what was not finished
  RecordingWriter(RecordingWriter&&) noexcept;
  RecordingWriter& operator=(RecordingWriter&&) noexcept;

  /// Appends rows in order. Throws Error(fault) when the disk refuses; what was flushed before stays readable, and
  /// every later append, flush and finish throws the same error.
  void append(std::span<const Sample> samples);
  void append(const StoredEvent& event);  ///< text beyond 127 bytes is cut after a whole character

  /// Makes everything appended so far visible to readers and safe from the death of this process.
  void flush();

  /// Flushes, marks the recording complete and closes it. Throws like append.
  void finish();

  /// Closes without marking it complete, keeping everything that was appended and fits on the disk. Never throws.
  void abandon() noexcept;

  [[nodiscard]] std::uint64_t rows() const noexcept;

 private:
  struct File;
  std::unique_ptr<File> file_;
};

/// Reads one recording, finished or not, without changing it. Files of other writers that keep the layout are read
/// whatever the precision, storage and filters of their datasets.
///
/// Threads: one thread at a time.
class RecordingReader {
 public:
  /// Throws Error(input): missing file, not HDF5, HDF5 that is something else, a newer format, missing datasets.
  explicit RecordingReader(const std::string& file);
  ~RecordingReader();
  RecordingReader(RecordingReader&&) noexcept;
  RecordingReader& operator=(RecordingReader&&) noexcept;

  [[nodiscard]] const RecordingHeader& header() const noexcept;
  [[nodiscard]] const RecordingColumns& columns() const noexcept;

  /// Rows that every dataset has (after a crash, the shortest), up to the last that has a time.
  [[nodiscard]] std::uint64_t rows() const noexcept;

  /// Takes notice of what a writer in another process has flushed since: rows, events and whether it is complete.
  void refresh();

  /// Reads rows [first, first + count), fewer at the end. Absent columns are NaN. Throws Error(input) on damage, naming
  /// the dataset and, where it is one, the row.
  [[nodiscard]] std::vector<Sample> read(std::uint64_t first, std::uint64_t count) const;
  [[nodiscard]] std::vector<StoredEvent> events() const;

 private:
  struct File;
  std::unique_ptr<File> file_;
};

/// One thing that a recording does not keep of docs/file-format.md.
struct Finding {
  enum class Severity { note, warning, error };
  Severity severity = Severity::error;
  std::string where;  ///< the object or row, for example "/samples/time[120]"
  std::string what;
};

/// Validates a file against the format; empty when it keeps all of it. Streams: memory is flat in the file's length.
/// Throws Error(input) only when the file cannot be read at all.
std::vector<Finding> check_recording(const std::string& file);

/// True when the file begins like HDF5.
bool is_hdf5(const std::string& file);

}  // namespace haptrace
