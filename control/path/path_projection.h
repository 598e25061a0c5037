// The foot point of a tool on a path, near the last one.
#pragma once

#include "control/path/arc_path.h"

#include <limits>

namespace haptrace {

/// Tracks the foot point of a moving tool on a path.
///
/// The foot point moves to the nearest point of the path within reach of its last position, forwards or backwards, by
/// at most max_speed times the tick (in a long tick by at most 1 mm more than the tool moved). So it never jumps: not
/// at crossings, not from one leg of a retraced stroke to the other, not from the end of a closed path to its start. It
/// knows nothing about what the tool did before: PlaceTracker says which part of the path is meant.
///
/// Every tick costs the same, whatever the path's length. Real-time: everything. Threads: one at a time. The path must
/// outlive this object.
class PathProjection {
 public:
  struct Options {
    double max_speed = 2;  ///< speed limit of the foot point along the path [m/s]
  };

  /// The tunnel at one point of the path, as seen from the tool.
  struct Tube {
    Vec3 centre = Vec3::Zero();    ///< point of the path [m]
    double radius = 0;             ///< [m]
    double distance = 0;           ///< from the centre to the tool [m]
    Vec3 outwards = Vec3::Zero();  ///< unit vector from the centre to the tool; zero on the path
  };

  /// The foot point and the position of the tool relative to it.
  struct Foot {
    double s = 0;                  ///< arc length [m]
    double speed = 0;              ///< ds/dt over the last 20 ms [m/s]
    double expert_speed = 0;       ///< expert's speed at the foot points of the same 20 ms [m/s]
    ArcPath::Place place;          ///< point of the path
    Vec3 offset = Vec3::Zero();    ///< from the foot point to the tool [m]
    double distance = 0;           ///< length of `offset` [m]
    Vec3 outwards = Vec3::Zero();  ///< unit vector from the foot point to the tool; zero on the path

    Tube tube;                     ///< tunnel for the walls: that of the foot point, or the nearest plausible one
    Tube tube_before;              ///< for the same tool, as if the plausible places had not changed at this tick
    double certainty = 1;          ///< share of the expert's force that may act, 0 while the place is in doubt
    double heading_certainty = 1;  ///< share of the help along the path that may act
    bool relocated = false;  ///< the foot point moved to another part of the path at this tick: nobody walked there
  };

  PathProjection(const ArcPath& path, const Options& options) noexcept : path_(&path), options_(options) {}

  /// Starts at arc length `s` [m].
  void start(double s = 0) noexcept;

  /// Moves the foot point for a tool at `position` [m], `dt` [s] after the last update (0 at the first), within the
  /// arc lengths from `from` to `to` [m]: if it is outside, it moves there as fast as it may. A position that is not
  /// finite changes nothing.
  const Foot& update(const Vec3& position, double dt, double from = 0,
                     double to = std::numeric_limits<double>::infinity()) noexcept;

  /// Puts the foot point at arc length `s`, wherever the tool is. Used for a cursor that moves by itself.
  const Foot& move_to(double s, const Vec3& position, double dt) noexcept;

  [[nodiscard]] const Foot& foot() const noexcept { return foot_; }

  /// Returns the tunnel of `radius` [m] round `centre` [m], as seen from a tool at `position` [m].
  [[nodiscard]] static Tube tube_of(const Vec3& centre, double radius, const Vec3& position) noexcept;

 private:
  /// Searches from `from` to `to` for a point nearer than `best`. `beyond` a rise of the distance, a point must be
  /// nearer by more than rounding.
  void look(double from, double to, bool beyond, const Vec3& position, ArcPath::Nearest& best) const noexcept;
  const Foot& stand_at(double s, const Vec3& position, double dt) noexcept;

  const ArcPath* path_;
  Options options_;
  Foot foot_;
};

}  // namespace haptrace
