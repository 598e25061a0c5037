// A path by its arc length: what guidance follows, since the trainee's time is his own.
#pragma once

#include "base/types.h"

#include <cstddef>
#include <string>
#include <vector>

namespace haptrace {

/// An expert's movement as a function of place: position, force and speed over arc length.
///
/// Knots lie a chord of `spacing` apart along the movement; the last segment may be shorter. Between them positions and
/// radii run straight, and forces between the middles of segments, where each is the mean over the expert's time there.
/// What the expert shook within less than a spacing is no way, and a pause is a place where he was slow.
///
/// Every answer costs O(1), whatever the length. Threads: const and safe to share. Real-time: all but the construction.
class ArcPath {
 public:
  /// What is known of one place.
  struct Place {
    Vec3 position = Vec3::Zero();  ///< [m]
    Vec3 tangent = Vec3::Zero();   ///< unit, in the direction of the movement; zero on a path without length
    Vec3 force = Vec3::Zero();     ///< the expert's, as recorded; zero when he had none [N]
    double speed = 0;              ///< the expert's there, his pauses counted in [m/s]
    double radius = 0;             ///< of the tunnel [m]
  };

  /// Collects a movement in the order of its time.
  class Builder {
   public:
    /// `spacing` [m] greater than 0; see spacing_for. Throws Error(input) otherwise.
    explicit Builder(double spacing);

    /// The next moment of the movement: time strictly after the one before [s], position [m], force [N]. Moves between
    /// two moments are taken as straight.
    void add(double time, const Vec3& position, const Vec3& force);

    /// The path with a tunnel of the same radius everywhere [m]. Throws Error(input) when nothing was added.
    ArcPath finish(double radius);

   private:
    void close_segment();

    double spacing_;
    std::vector<Vec3> position_;
    std::vector<double> time_;
    std::vector<Eigen::Vector3f> force_;
    Vec3 last_ = Vec3::Zero(), last_force_ = Vec3::Zero();
    double last_time_ = 0;
    Vec3 impulse_ = Vec3::Zero();  ///< of the force on the present segment [N s]
    double duration_ = 0;          ///< on the present segment [s]
  };

  /// A spacing for a movement whose box has this diagonal [m]: 0.25 mm for desktop devices, less for tiny paths.
  static double spacing_for(double extent);

  [[nodiscard]] double length() const noexcept { return length_; }  ///< [m]
  [[nodiscard]] double spacing() const noexcept { return spacing_; }
  [[nodiscard]] std::size_t knots() const noexcept { return position_.size(); }
  /// When the expert was at `s` [s], from his start.
  [[nodiscard]] double time_at(double s) const noexcept;
  /// Where the expert was at `time` [s] from his start [m]. Costs O(log knots).
  [[nodiscard]] double place_at(double time) const noexcept;
  /// At `s` [m], taken to the nearer end when it is beyond one; NaN asks for the start.
  [[nodiscard]] Place at(double s) const noexcept;
  [[nodiscard]] Vec3 position_at(double s) const noexcept;

  /// Arc length of knot `i` [m].
  [[nodiscard]] double knot_at(std::size_t i) const noexcept {
    return i + 1 < position_.size() ? spacing_ * static_cast<double>(i) : length_;
  }

  /// A radius for every knot [m], each greater than or equal to 0. Throws Error(input) when the number differs.
  void set_radius(const std::vector<double>& radius);

  /// The nearest place to `point` on segment `i`: arc length [m] and squared distance [m^2].
  struct Nearest {
    double s = 0, squared_distance = 0;
  };
  [[nodiscard]] Nearest nearest_on(std::size_t i, const Vec3& point) const noexcept;
  [[nodiscard]] std::size_t segments() const noexcept { return position_.size() - 1; }
  /// The segment that holds `s`.
  [[nodiscard]] std::size_t segment_at(double s) const noexcept;

 private:
  ArcPath() = default;
  struct Where {
    std::size_t segment = 0;
    double share = 0;  ///< of the segment that lies before it
  };
  [[nodiscard]] Where where(double s) const noexcept;
  [[nodiscard]] double segment_length(std::size_t i) const noexcept { return knot_at(i + 1) - knot_at(i); }

  double spacing_ = 0, length_ = 0;
  std::vector<Vec3> position_;
  std::vector<Eigen::Vector3f> force_;  ///< mean over the time on each segment; one on a path without any
  std::vector<double> time_;
  std::vector<float> radius_;
};

}  // namespace haptrace
