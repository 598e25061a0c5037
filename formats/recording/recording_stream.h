// Recordings as streams of samples, whatever the format: HDF5, CSV, JSON lines, and XDF to read.
//
//   source -> changes, each a source around another (cut, resample, anonymise) -> sink
//
// Memory is flat in the length of a file. Threads: one thread at a time.
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

/// Where samples come from, in order.
class RecordingSource {
 public:
  virtual ~RecordingSource() = default;
  [[nodiscard]] virtual const RecordingHeader& header() const = 0;
  [[nodiscard]] virtual const RecordingColumns& columns() const = 0;

  /// All events; known from the start.
  [[nodiscard]] virtual std::vector<StoredEvent> events() const = 0;

  /// All readings of the computer's clocks; known from the start.
  [[nodiscard]] virtual std::vector<ClockReading> clocks() const { return {}; }

  /// The next samples, valid until the next call; empty at the end. Time increases. Throws Error(input) on damage,
  /// naming file and row.
  virtual std::span<const Sample> next() = 0;

  /// Leaves out samples before `time_ns` where that is quick; some may still come.
  virtual void skip_to(std::int64_t time_ns) { (void)time_ns; }

  /// How much has been read, 0 to 1: for a progress bar.
  [[nodiscard]] virtual double fraction() const = 0;

  /// What a person should know. Complete once next() was empty.
  [[nodiscard]] virtual std::vector<std::string> notes() const = 0;
};

/// Where samples go, in order. A sink that is destroyed before finish() leaves nothing behind, and a file that it was
/// to replace as it was.
class RecordingSink {
 public:
  virtual ~RecordingSink() = default;
  /// Throws Error when the disk refuses.
  virtual void append(std::span<const Sample> samples) = 0;
  /// Makes the file whole. Throws like append.
  virtual void finish() = 0;
};

struct SourceOptions {
  /// Texts and XDF: hand on rows whose time does not increase, for resample() to drop; else they are an error.
  bool any_order = false;

  /// CSV: what its header leaves open. Its `name` is what messages call a file of any format.
  CsvOptions csv;

  /// HDF5: which of a recording's files are read.
  RecordingReader::Parts parts = RecordingReader::Parts::all;

  /// XDF: names or types of the streams to read. The first gives the rows, the others are held: their newest value at
  /// the time of a row. Empty: the only stream with x, y and z.
  std::vector<std::string> streams;
  /// XDF: the label of the channel for a CSV column name, as in {"x", "Pos X"}; more than what is found by itself.
  std::map<std::string, std::string> channels;
  /// XDF: replace the stamps by an even clock fitted to them, gap by gap.
  bool dejitter = false;
};

/// Opens a recording or a path, told apart by content. A CSV without our header (docs/file-format.md) is a path: its
/// time starts at zero, tick is the row, phase is run; a velocity or force that some rows lack is left out.
/// Throws Error(input): missing, none of the formats, damaged; CsvOptions that are not empty for another format.
std::unique_ptr<RecordingSource> open_source(const std::string& file, const SourceOptions& options = {});

struct SinkOptions {
  bool overwrite = false;
  int digits = 0;  ///< CSV and JSON lines: significant digits of measured values; 0: as many as bring them back exactly
  std::vector<ClockReading> clocks = {};  ///< of the source
  RecordingWriter::Options hdf5;          ///< its `overwrite` is the one above
};

/// The name of a sink that writes CSV to standard output.
inline constexpr std::string_view kStandardOutput = "-";

/// Creates a file; its ending says which format: .h5 .hdf5 .csv .jsonl. kStandardOutput is CSV. Throws Error(input):
/// another ending, a file that exists (unless `overwrite`), a folder that is missing.
std::unique_ptr<RecordingSink> create_sink(const std::string& file, const RecordingHeader& header,
                                           const RecordingColumns& columns, const std::vector<StoredEvent>& events,
                                           const SinkOptions& options);

/// Shows every block to `see` and changes nothing.
std::unique_ptr<RecordingSource> observe(std::unique_ptr<RecordingSource> source,
                                         std::function<void(std::span<const Sample>)> see);

/// The part of `source` from `from` to `to` [s], both included. Time starts at zero again; the ticks stay. It has a
/// uuid of its own. Throws Error(input) when nothing is between.
std::unique_ptr<RecordingSource> cut(std::unique_ptr<RecordingSource> source, double from, double to);

/// Passes everything on. Answers how many samples there were. `stopped`, asked after every block, ends it early.
struct CopyProgress {
  std::function<void(double fraction)> report;
  std::function<bool()> stopped;
};
std::uint64_t copy(RecordingSource& source, RecordingSink& sink, const CopyProgress& progress = {});

}  // namespace haptrace
