// The reference of a playback, from a path of any length.
#pragma once

#include "control/path/orientation_trajectory.h"
#include "control/path/trajectory.h"
#include "devices/loop/prefetcher.h"
#include "formats/path/path_source.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// The trajectory through consecutive rows of a path.
struct TrajectoryPiece {
  double begin = 0, end = 0;  ///< it holds for [begin, end] of the whole trajectory's time [s]
  Trajectory trajectory;
  OrientationTrajectory orientation;  ///< empty when the path has none
};

/// The trajectory through a path in pieces that are made when they are needed: the same as Trajectory of the whole path
/// to the last bits, but that the decisions for or against the path's own velocities and how much to smooth are taken
/// from a few stretches of a long path, and once for all of it.
///
/// Threads: const, but one thread at a time. A copy shares the source.
class TrajectoryPieces {
 public:
  struct Options {
    std::uint64_t rows = 16'384;       ///< of a piece
    std::uint64_t undivided = 65'536;  ///< a path of up to so many rows is one piece
    /// Time constant of smoothing [s], for cubic and quintic: 0 for none; as much as its noise asks for when absent.
    std::optional<double> smoothing;
    bool orientation = false;  ///< pieces hold the path's orientations, if it has any
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

  /// Throws like the constructor.
  [[nodiscard]] TrajectoryPiece make(std::size_t index) const;
  /// The piece through rows [first, last], first < last, or the only row.
  [[nodiscard]] TrajectoryPiece through(std::uint64_t first, std::uint64_t last) const;

 private:
  struct Rows {
    std::uint64_t begin = 0, end = 0;  ///< half-open
  };
  /// Those that the trajectory through [first, last] depends on.
  [[nodiscard]] Rows with_overlap(std::uint64_t first, std::uint64_t last) const;
  /// Stretches that stand for the whole path.
  [[nodiscard]] std::vector<Path> stretches() const;

  std::shared_ptr<const PathSource> source_;
  Interpolation interpolation_;
  bool with_orientation_;
  std::uint64_t rows_ = 0;  ///< of a piece
  std::size_t count_ = 1;
  Trajectory::Whole whole_;
  std::shared_ptr<const TrajectoryPiece> first_;
};

/// What a controller asks for its reference while a thread reads ahead. A path of one piece needs no thread.
///
/// Threads: one thread at a time. Real-time: sample().
class ReferenceStream {
 public:
  /// Of a piece that was read, before it is used: throws when it must not be played.
  using Check = std::function<void(const TrajectoryPiece&)>;

  enum class [[nodiscard]] Answer : std::uint8_t{
      ready,
      waiting,     ///< it has not been read yet: ask again
      unreadable,  ///< it cannot be read, or must not be played: see error()
  };

  /// Reads at least two pieces and kAhead seconds ahead, as they pass at `speed` times the path's own.
  ReferenceStream(const TrajectoryPieces& pieces, const Check& check, double speed = 1);

  /// Of a trajectory that is all there.
  ReferenceStream(Trajectory trajectory);  // NOLINT(google-explicit-constructor): it is one

  /// The reference at `t` [s], which goes forward, or to any time within the first piece. Sets `reference` when ready.
  Answer sample(double t, Reference& reference) noexcept;

  /// How the tool points at the time that sample() was asked for last.
  [[nodiscard]] OrientationReference orientation(double t) noexcept {
    return piece_->orientation.sample(t, orientation_cursor_);
  }

  /// Waits until sample() can answer at `t`, at most `ahead` pieces from the last question. Not for the tick.
  void wait(double t) noexcept;

  [[nodiscard]] double duration() const noexcept { return duration_; }  ///< [s]

  /// Why sample() answered unreadable.
  [[nodiscard]] const std::string& error() const noexcept { return prefetcher_->error(); }

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
