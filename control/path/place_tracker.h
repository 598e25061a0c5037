// The place of a trainee on a path, which is found again wherever the trainee goes.
#pragma once

#include "control/path/path_projection.h"
#include "control/path/place_evidence.h"

namespace haptrace {

/// Tracks the place of a moving tool on a path, and how certain it is.
///
/// Two layers find the place. PlaceEvidence weighs all places by the movement so far; within 4 mm of the best place
/// near by, PathProjection finds the exact foot point at every tick, forwards and backwards. If a place elsewhere
/// becomes more plausible than those near by, because the trainee turned early, cut a corner, skipped a part or went
/// back, the foot point moves there: by sliding if it is less than 60 mm away, else at once, after
/// `Foot::certainty` has faded to 0. A foot point that bears force never moves faster than PathProjection allows.
///
/// `Foot::tube` is the nearest tunnel of all places that are plausible, not only of the foot point: a wall that acts on
/// it pushes nobody who may be right. It is a union of tunnels, and never an average, which would attract to where no
/// path is. Where strands meet, it does not oppose a shortcut of up to 40 mm. Without `allow_back`, the union begins at
/// the farthest place that the foot point reached since it last moved elsewhere: walls then hold a trainee who goes
/// back.
///
/// All these lengths are those of a path whose box has a diagonal of 110 mm, and scale with it.
///
/// Real-time: all but the constructor. Threads: one at a time. The path must outlive this object.
class PlaceTracker {
 public:
  struct Options {
    bool allow_back = false;  ///< walls do not hold a trainee who goes back
    double max_speed = 2;     ///< speed limit of the foot point along the path [m/s]
    double resolution = 0;    ///< position resolution of the device [m], or its noise if larger
  };
  using Foot = PathProjection::Foot;

  PlaceTracker(const ArcPath& path, const Options& options);

  /// Starts at arc length `s` [m].
  void start(double s = 0) noexcept;
  /// Moves the foot point for a tool at `position` [m], `dt` [s] after the last update (0 at the first). A position
  /// that is not finite changes nothing.
  const Foot& update(const Vec3& position, double dt) noexcept;
  /// Leaves the foot point where it is, and the tunnel there, wherever the tool is. The expert rests: nobody is too
  /// slow who holds still at the end of a path.
  const Foot& hold(const Vec3& position, double dt) noexcept;
  /// Puts the foot point at arc length `s`, wherever the tool is. Used for a cursor that moves by itself.
  const Foot& move_to(double s, const Vec3& position, double dt) noexcept;

  [[nodiscard]] const Foot& foot() const noexcept { return foot_; }
  /// Returns another place that is nearly as plausible [m]; NaN while there is none.
  [[nodiscard]] double rival() const noexcept { return rival_; }

 private:
  /// The plausible tunnels.
  struct Union {
    std::array<PlaceEvidence::Stretch, PlaceEvidence::kMostStretches> stretches;
    std::size_t count = 0;
    double place = 0;  ///< arc length of the foot point [m]
    double floor = 0;  ///< arc length at which the union begins [m]
  };
  [[nodiscard]] PathProjection::Tube tube_at(const Vec3& position, const Union& tunnels) const noexcept;
  /// Anchors the foot point, or decides that it moves elsewhere, after new evidence.
  void look_about() noexcept;
  /// Compares the place with its rivals.
  void weigh_rivals(const PlaceEvidence::Candidate& near) noexcept;
  /// Doubts a place from which the hand stays away while it follows another lap in the same direction: a lap too early
  /// or too late looks like a copy that is shifted, and nothing but the memory speaks for either.
  void doubt_laps(const ArcPath::Place& place) noexcept;
  void fade(double dt) noexcept;
  /// Takes a new foot point; the certainty fades on.
  void take(const Foot& foot) noexcept;
  /// Lays the union of tunnels round the foot point for this tick.
  void lay_tunnels(const Vec3& position, bool changed) noexcept;

  const ArcPath* path_;
  Options options_;
  double scale_;
  PlaceEvidence evidence_;
  PathProjection projection_;
  Foot foot_;
  bool begun_ = false;
  double anchor_ = 0;                   ///< [m]
  double target_ = kNaN;                ///< where the foot point moves [m]; NaN: nowhere
  bool far_ = false;                    ///< the target is so far away that the forces fade first
  double rival_ = kNaN;                 ///< [m]
  double certainty_ = 1, heading_ = 1;  ///< to which those of the foot fade
  Union union_;
};

}  // namespace haptrace
