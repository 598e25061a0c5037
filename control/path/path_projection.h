// Where on a path a trainee is.
#pragma once

#include "control/path/arc_path.h"

namespace haptrace {

/// Follows the place on a path that belongs to a tool that moves along it.
///
/// From the place of the tick before, the nearest one within reach is taken: as far ahead as somebody moves in a tick
/// who is at most max_speed fast (but in a long tick no more than 1 mm beyond what the tool moved), and as far back if
/// that is allowed. So the place never jumps: not at crossings, not to another turn that passes near by, not from one
/// leg of a retraced stroke to the other, not from the end of a closed path to its beginning. Past a corner that the
/// tool cut, or the end of a stroke that it turned before, the place slides at that speed, when it is nearer to what
/// follows within 40 spacings (10 mm) of the path. Without going back (the default) a trainee who returns is held at
/// the farthest place that he reached. The search for the nearest place on the whole path does jump, by up to the size
/// of the path.
///
/// Every tick costs the same, whatever the path's length. Real-time: all. Threads: one at a time. The path is borrowed.
class PathProjection {
 public:
  struct Options {
    bool allow_back = false;
    double max_speed = 2;  ///< of the place along the path [m/s]
  };

  /// What there is at the place, and how the tool stands to it.
  struct Foot {
    double s = 0;                  ///< arc length [m]
    double speed = 0;              ///< ds/dt over the last 20 ms [m/s]
    double expert_speed = 0;       ///< of the expert at the places of the same 20 ms [m/s]
    ArcPath::Place place;          ///< of the path
    Vec3 offset = Vec3::Zero();    ///< from the place to the tool [m]
    double distance = 0;           ///< length of that [m]
    Vec3 outwards = Vec3::Zero();  ///< unit, from the place to the tool; zero on the path
  };

  PathProjection(const ArcPath& path, const Options& options) noexcept : path_(&path), options_(options) {}

  /// Begins at `s` [m].
  void start(double s = 0) noexcept;

  /// The tool is at `position` [m], `dt` [s] after the last update (0 at the first). A position that is not finite
  /// changes nothing.
  const Foot& update(const Vec3& position, double dt) noexcept;

  /// The place is at `s`, wherever the tool is: for a cursor that moves by itself.
  const Foot& move_to(double s, const Vec3& position, double dt) noexcept;

  [[nodiscard]] const Foot& foot() const noexcept { return foot_; }

 private:
  /// Takes what is nearer than `best` between `from` and `to`. `beyond` a rise of the distance from where the trainee
  /// was, it has to be nearer by more than rounding.
  void look(double from, double to, bool beyond, const Vec3& position, ArcPath::Nearest& best) const noexcept;
  const Foot& stand_at(double s, const Vec3& position, double dt) noexcept;

  const ArcPath* path_;
  Options options_;
  Foot foot_;
};

}  // namespace haptrace
