// Recordings as streams of samples, in any format: HDF5, CSV, JSON lines, and XDF for reading.
//
//   source -> filters, each a source around another (cut, resample, anonymise) -> sink
//
// Memory does not grow with the length of a file. Threads: one thread at a time.
#pragma once

#include "formats/path/csv_options.h"
#include "formats/recording/recording.h"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Source of samples, in order.
class RecordingSource {
 public:
  virtual ~RecordingSource() = default;
  [[nodiscard]] virtual const RecordingHeader& header() const = 0;
  [[nodiscard]] virtual const RecordingColumns& columns() const = 0;

  /// Returns all events; known from the start.
  [[nodiscard]] virtual std::vector<StoredEvent> events() const = 0;

  /// Returns all readings of the computer's clocks; known from the start.
  [[nodiscard]] virtual std::vector<ClockReading> clocks() const { return {}; }

  /// Returns the next samples, valid until the next call; empty at the end. Time increases. Throws Error(input) on
  /// damage, naming file and row.
  virtual std::span<const Sample> next() = 0;

  /// Returns the contacts of the samples that next() returned last. A source whose columns() have none has none.
  [[nodiscard]] virtual std::span<const ContactSample> contacts() const { return {}; }

  /// Skips samples before `time_ns` if that is quick. Some may still come.
  virtual void skip_to(std::int64_t time_ns) { (void)time_ns; }

  /// Returns the share that has been read, 0 to 1, for a progress bar.
  [[nodiscard]] virtual double fraction() const = 0;

  /// Returns notes for the user. Complete once next() has returned no samples.
  [[nodiscard]] virtual std::vector<std::string> notes() const = 0;
};

/// Destination of samples, in order. If a sink is destroyed before finish(), it leaves nothing behind, and a file that
/// it should replace stays unchanged.
class RecordingSink {
 public:
  virtual ~RecordingSink() = default;
  /// Throws Error if a write to the disk fails.
  virtual void append(std::span<const Sample> samples) = 0;
  /// Takes the contacts of these samples. Text formats have no place for them.
  virtual void append_contacts(std::span<const ContactSample> contacts) { (void)contacts; }
  /// Completes the file. Throws like append.
  virtual void finish() = 0;
};

struct SourceOptions {
  /// Text and XDF: pass on rows whose time does not increase, for resample() to drop. Otherwise they are an error.
  bool any_order = false;

  /// CSV: settings that its header leaves open. For any format, messages call the file by its `name`.
  CsvOptions csv;

  /// HDF5: files of the recording to read.
  RecordingReader::Parts parts = RecordingReader::Parts::all;

  /// XDF: names or types of the streams to read. The first provides the rows. The others are held: they contribute
  /// their newest value at the time of a row. Empty: the only stream with x, y and z.
  std::vector<std::string> streams;
  /// XDF: channel label for a CSV column name, as in {"x", "Pos X"}. It replaces the labels that are recognised by
  /// default.
  std::map<std::string, std::string> channels;
  /// XDF: replace the stamps by an even clock fitted to them. A gap starts a new clock.
  bool dejitter = false;
};

/// Opens a recording or a path; the content tells the format. A CSV file without haptrace's header
/// (docs/file-format.md) is a path: its time starts at zero, tick is the row, phase is run, and a velocity or force
/// that some rows lack is left out.
/// Throws Error(input) if the file is missing, damaged or of none of the formats, or if CsvOptions are not empty for
/// another format.
std::unique_ptr<RecordingSource> open_source(const std::string& file, const SourceOptions& options = {});

struct SinkOptions {
  bool overwrite = false;
  int digits = 0;  ///< CSV and JSON lines: significant digits of measured values; 0: enough to read them back exactly
  std::vector<ClockReading> clocks = {};  ///< of the source
  RecordingWriter::Options hdf5;          ///< the `overwrite` above replaces its own
};

/// Name of a sink that writes CSV to standard output.
inline constexpr std::string_view kStandardOutput = "-";

/// Creates a file in the format of its ending: .h5 .hdf5 .csv .jsonl. kStandardOutput is CSV. Throws Error(input) for
/// another ending, a file that exists (unless `overwrite`), or a missing folder.
std::unique_ptr<RecordingSink> create_sink(const std::string& file, const RecordingHeader& header,
                                           const RecordingColumns& columns, const std::vector<StoredEvent>& events,
                                           const SinkOptions& options);

/// Passes every block to `see` and changes nothing.
std::unique_ptr<RecordingSource> observe(std::unique_ptr<RecordingSource> source,
                                         std::function<void(std::span<const Sample>)> see);

/// Returns the part of `source` from `from` to `to` [s], both included. Time starts at zero again; the ticks stay. The
/// part has its own uuid. Throws Error(input) if it contains no sample.
std::unique_ptr<RecordingSource> cut(std::unique_ptr<RecordingSource> source, double from, double to);

/// Callbacks of copy(), which calls both after every block. If `stopped` returns true, the copy ends early.
struct CopyProgress {
  std::function<void(double fraction)> report;
  std::function<bool()> stopped;
};
/// Passes all samples on. Returns how many there were.
std::uint64_t copy(RecordingSource& source, RecordingSink& sink, const CopyProgress& progress = {});

}  // namespace haptrace
