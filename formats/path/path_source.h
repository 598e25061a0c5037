// Paths that are read piece by piece, so that their length costs nothing.
#pragma once

#include "control/path/path.h"
#include "formats/recording/recording.h"

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// What is known of a path before it is read.
struct PathFacts {
  std::string name;  ///< for messages: usually the file
  std::uint64_t rows = 0;
  double begin = 0, end = 0;       ///< stamps of the first and the last row [s]
  Box bounds;                      ///< of its positions [m]
  double peak_speed = 0;           ///< over 10 ms, or between two rows that are farther apart [m/s]
  double longest_interval = 0;     ///< between two rows [s]
  bool velocity = false;           ///< every row has a velocity, and pieces hold it
  bool force = false;              ///< every row has a force, and pieces hold it
  bool orientation = false;        ///< pieces hold orientations
  std::vector<std::string> notes;  ///< what a person should know

  [[nodiscard]] double duration() const noexcept { return end - begin; }
};

/// The same of consecutive rows; together these make up the path.
struct PathBlock {
  std::uint64_t first = 0, rows = 0;
  Box bounds;
  double peak_speed = 0;
  double longest_interval = 0;  ///< the one to the row that follows included
};

/// A path that is read as it is needed.
///
/// Threads: const, but one thread at a time.
class PathSource {
 public:
  virtual ~PathSource() = default;

  [[nodiscard]] const PathFacts& facts() const noexcept { return facts_; }
  [[nodiscard]] const std::vector<PathBlock>& blocks() const noexcept { return blocks_; }

  /// Rows [first, first + count), fewer at the end: at least one. Throws Error(input) naming the row when they are
  /// damaged or no path.
  [[nodiscard]] virtual Path read(std::uint64_t first, std::uint64_t count) const = 0;

  /// The last row whose stamp is at most `time` [s]; 0 when there is none. Costs O(log rows).
  [[nodiscard]] virtual std::uint64_t row_at(double time) const = 0;

  void note(std::string text) { facts_.notes.push_back(std::move(text)); }

 protected:
  PathFacts facts_;
  std::vector<PathBlock> blocks_;
};

/// Which part of a file is the path.
struct PathSelection {
  double from = -std::numeric_limits<double>::infinity();  ///< rows with stamps from here [s] ...
  double to = std::numeric_limits<double>::infinity();     ///< ... to here
  std::optional<int> repetition;  ///< of a recording that holds several runs: which, from 1; the last when absent
};

/// Told while a file is looked through that has no figures of its own: rows done.
using RowsDone = std::function<void(std::uint64_t)>;

/// A path in memory, the part of it between `from` and `to`. Throws Error(input) like validate, when nothing is
/// selected, and when a repetition is asked for: a path has none.
std::unique_ptr<PathSource> source_of(Path path, const PathSelection& selection = {});

/// Where a recording does not know how the tool pointed, it points as it did last.
///
/// A recording: the rows of phase run of one repetition, or all rows when none is of phase run. Opens in milliseconds
/// at any length, since nothing is read but the recording's overview and the blocks in which the path begins and ends.
/// Throws Error(input): no rows, none selected, a repetition that is not there, positions that are not numbers.
std::unique_ptr<PathSource> source_of(RecordingReader reader, const std::string& name,
                                      const PathSelection& selection = {}, const RowsDone& progress = {});

}  // namespace haptrace
