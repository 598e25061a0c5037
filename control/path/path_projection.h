// The position of a trainee on a path.
#pragma once

#include "control/path/arc_path.h"

namespace haptrace {

/// Tracks the foot point of a moving tool on a path.
///
/// The foot point moves to the nearest point of the path within reach of its last position. It moves ahead by at most
/// max_speed times the tick (in a long tick by at most 1 mm more than the tool moved), and back by as much if that is
/// allowed. So it never jumps: not at crossings, not to a turn that passes near by, not from one leg of a retraced
/// stroke to the other, not from the end of a closed path to its start. If the tool cuts a corner or turns before the
/// end of a stroke, the foot point slides past it at max_speed, provided that the tool is nearer to the path within the
/// next 40 spacings (10 mm). Without going back (the default), the foot point stays at the farthest point that the
/// trainee reached. A search for the nearest point of the whole path would jump by up to the size of the path.
///
/// Every tick costs the same, whatever the path's length. Real-time: everything. Threads: one at a time. The path must
/// outlive this object.
class PathProjection {
 public:
  struct Options {
    bool allow_back = false;
    double max_speed = 2;  ///< speed limit of the foot point along the path [m/s]
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
  };

  PathProjection(const ArcPath& path, const Options& options) noexcept : path_(&path), options_(options) {}

  /// Starts at arc length `s` [m].
  void start(double s = 0) noexcept;

  /// Moves the foot point for a tool at `position` [m], `dt` [s] after the last update (0 at the first). A position
  /// that is not finite changes nothing.
  const Foot& update(const Vec3& position, double dt) noexcept;

  /// Puts the foot point at arc length `s`, wherever the tool is. Used for a cursor that moves by itself.
  const Foot& move_to(double s, const Vec3& position, double dt) noexcept;

  [[nodiscard]] const Foot& foot() const noexcept { return foot_; }

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
