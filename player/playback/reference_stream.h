// Reference of a playback from a path of any length.
#pragma once

#include "control/path/orientation_trajectory.h"
#include "control/path/trajectory.h"
#include "formats/path/path_source.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

template <class Block>
class Prefetcher;

/// Trajectory through consecutive samples of a path.
struct TrajectoryPiece {
  double begin = 0, end = 0;  ///< range of validity in the whole trajectory's time [s]
  Trajectory trajectory;
  OrientationTrajectory orientation;  ///< empty when the path has none
};

/// Trajectory through a path, made in pieces when they are needed. It equals Trajectory of the whole path up to the
/// last bits, with one exception: a few stretches of a long path decide for all of it whether the path's own velocities
/// are used and how much it is smoothed.
///
/// Threads: const, but one thread at a time. A copy shares the source.
class TrajectoryPieces {
 public:
  struct Options {
    std::uint64_t rows = 16'384;       ///< samples per piece
    std::uint64_t undivided = 65'536;  ///< a path with at most this many samples is one piece
    /// Time constant of smoothing [s], for cubic and quintic. 0: none; absent: chosen from the path's noise.
    std::optional<double> smoothing;
    bool orientation = false;  ///< pieces include the path's orientations, if it has any
  };

  /// Makes the first piece. Throws Error(input) like PathSource::read and Trajectory, and when
  /// the smoothing is longer than 1 s or negative.
  TrajectoryPieces(std::shared_ptr<const PathSource> source, Interpolation interpolation, const Options& options);
  TrajectoryPieces(std::shared_ptr<const PathSource> source, Interpolation interpolation)
      : TrajectoryPieces(std::move(source), interpolation, Options{}) {}

  [[nodiscard]] const PathSource& source() const noexcept { return *source_; }
  [[nodiscard]] std::size_t count() const noexcept { return count_; }
  [[nodiscard]] double duration() const noexcept { return whole_.end - whole_.begin; }  ///< [s]
  [[nodiscard]] double smoothing() const noexcept { return whole_.smoothing; }          ///< time constant [s]
  [[nodiscard]] const std::shared_ptr<const TrajectoryPiece>& first() const noexcept { return first_; }

  /// Returns piece `index`. Throws like the constructor.
  [[nodiscard]] TrajectoryPiece make(std::size_t index) const;
  /// Returns the piece through samples [first, last], with first < last unless the path has only one sample.
  [[nodiscard]] TrajectoryPiece through(std::uint64_t first, std::uint64_t last) const;

 private:
  struct Rows {
    std::uint64_t begin = 0, end = 0;  ///< end is exclusive
  };
  /// Returns the samples on which the trajectory through [first, last] depends.
  [[nodiscard]] Rows with_overlap(std::uint64_t first, std::uint64_t last) const;
  /// Returns stretches that represent the whole path.
  [[nodiscard]] std::vector<Path> stretches() const;

  std::shared_ptr<const PathSource> source_;
  Interpolation interpolation_;
  bool with_orientation_;
  std::uint64_t rows_ = 0;  ///< samples per piece
  std::size_t count_ = 1;
  Trajectory::Whole whole_;
  std::shared_ptr<const TrajectoryPiece> first_;
};

/// Source of a controller's reference; a thread reads ahead. A path of one piece needs no thread.
///
/// Threads: one thread at a time. Real-time: sample().
class ReferenceStream {
 public:
  /// Checks a piece after it was read and before it is used. Throws if the piece must not be played.
  using Check = std::function<void(const TrajectoryPiece&)>;

  enum class [[nodiscard]] Answer : std::uint8_t{
      ready,
      waiting,     ///< not read yet: ask again
      unreadable,  ///< cannot be read or must not be played, see error()
  };

  /// Reads at least two pieces ahead, and kAhead seconds at `speed` relative to the path's own, at most 64 pieces.
  ReferenceStream(const TrajectoryPieces& pieces, const Check& check, double speed = 1);

  /// Makes a stream of a complete trajectory.
  ReferenceStream(Trajectory trajectory);  // NOLINT(google-explicit-constructor): it is one
  ReferenceStream(ReferenceStream&&) noexcept;
  ReferenceStream& operator=(ReferenceStream&&) noexcept;
  ~ReferenceStream();

  /// Sets `reference` to the reference at `t` [s] if it returns `ready`. `t` must not decrease, except to a time within
  /// the first piece.
  Answer sample(double t, Reference& reference) noexcept;

  /// Returns the orientation at `t` [s], the time of the last sample() call.
  [[nodiscard]] OrientationReference orientation(double t) noexcept {
    return piece_->orientation.sample(t, orientation_cursor_);
  }

  /// Waits until sample() can answer at `t`, which must lie within the pieces that are read ahead. Not real-time.
  void wait(double t) noexcept;

  [[nodiscard]] double duration() const noexcept { return duration_; }  ///< [s]

  /// Returns why sample() returned `unreadable`.
  [[nodiscard]] const std::string& error() const noexcept;

  static constexpr double kAhead = 10;  // [s]

 private:
  double duration_ = 0;
  std::unique_ptr<Prefetcher<TrajectoryPiece>> prefetcher_;
  std::size_t count_ = 1;
  std::size_t index_ = 0;
  const TrajectoryPiece* piece_ = nullptr;
  Trajectory::Cursor cursor_, orientation_cursor_;
};

}  // namespace haptrace
