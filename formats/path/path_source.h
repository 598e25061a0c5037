// Paths that are read piece by piece, so that memory does not depend on their length.
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

/// Properties of a path that are known before it is read.
struct PathFacts {
  std::string name;  ///< for messages: usually the file
  std::uint64_t rows = 0;
  double begin = 0, end = 0;    ///< stamps of the first and the last row [s]
  Box bounds;                   ///< of the positions [m]
  double peak_speed = 0;        ///< over 10 ms, or between two rows that are farther apart [m/s]
  double longest_interval = 0;  ///< between two rows [s]
  bool velocity = false;        ///< every row has a velocity, and pieces contain it
  bool force = false;           ///< every row has a force, and pieces contain it
  bool measured = false;        ///< the recording has a measured force, see PathSelection
  bool orientation = false;     ///< pieces contain orientations
  bool contacts = false;        ///< recorded with a scene: the forces hold those of its objects
  bool supported = false;       ///< a force carried the arm while it was recorded; it is not in the force of the path
  bool cut_short = false;       ///< of several repetitions, this one was ended by a time limit, a stop or a fault
  std::vector<std::string> notes;  ///< notes for the user

  [[nodiscard]] double duration() const noexcept { return end - begin; }
};

/// Properties of consecutive rows. All blocks together make up the path.
struct PathBlock {
  std::uint64_t first = 0, rows = 0;
  Box bounds;
  double peak_speed = 0;
  double longest_interval = 0;  ///< including the interval to the next row
};

/// A path that is read on demand.
///
/// Threads: const, but one thread at a time.
class PathSource {
 public:
  virtual ~PathSource() = default;

  [[nodiscard]] const PathFacts& facts() const noexcept { return facts_; }
  [[nodiscard]] const std::vector<PathBlock>& blocks() const noexcept { return blocks_; }

  /// Returns rows [first, first + count), fewer at the end, but at least one. Throws Error(input) naming the row if
  /// rows are damaged or not a valid path.
  [[nodiscard]] virtual Path read(std::uint64_t first, std::uint64_t count) const = 0;

  /// Returns the last row whose stamp is at most `time` [s]; 0 if there is none. Costs O(log rows).
  [[nodiscard]] virtual std::uint64_t row_at(double time) const = 0;

  void note(std::string text) { facts_.notes.push_back(std::move(text)); }

 protected:
  PathFacts facts_;
  std::vector<PathBlock> blocks_;
};

/// Part of a file that is the path.
struct PathSelection {
  double from = -std::numeric_limits<double>::infinity();  ///< rows with stamps from here [s] ...
  double to = std::numeric_limits<double>::infinity();     ///< ... to here
  bool measured = false;          ///< read the measured force of a recording in place of the sent one
  bool negated = false;           ///< the measured force is that of the hand on the device
  std::optional<int> repetition;  ///< run of a recording with several runs, from 1; absent: the last one that was not
                                  ///< cut short, or the last
};

/// Receives the number of rows done while a file without stored statistics is read.
using RowsDone = std::function<void(std::uint64_t)>;

/// Returns the part of a path in memory between `from` and `to`. Throws Error(input) like validate, if nothing is
/// selected, and if a repetition is requested: a path has none.
std::unique_ptr<PathSource> source_of(Path path, const PathSelection& selection = {});

/// Returns the path of a recording: the rows of phase run of one repetition, or all rows if none is of phase run. If a
/// recording lacks an orientation, the last known one is used. Its forces are without the support of the arm
/// (ArmSupport) in the session: that belongs to the arm that was carried.
///
/// Opening takes milliseconds at any length, since it reads only the overview and the blocks in which the path begins
/// and ends. Throws Error(input) if there are no rows, none is selected, the repetition does not exist, or a position
/// is not finite.
std::unique_ptr<PathSource> source_of(RecordingReader reader, const std::string& name,
                                      const PathSelection& selection = {}, const RowsDone& progress = {});

}  // namespace haptrace
