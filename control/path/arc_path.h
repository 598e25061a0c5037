// A path parameterised by arc length. Guidance follows it because trainees move at their own pace.
#pragma once

#include "base/types.h"

#include <cstddef>
#include <string>
#include <vector>

namespace haptrace {

/// Represents an expert's movement as a function of arc length: position, force and speed.
///
/// Neighbouring knots are a chord of `spacing` apart; the last segment may be shorter. Positions and radii are linear
/// between knots. Each segment has one force, the mean over the expert's time on it; forces are linear between the
/// midpoints of segments. Tremor smaller than a spacing does not count as movement, and a pause only lowers the
/// expert's speed at that point.
///
/// Every query except place_at costs O(1), whatever the length. Threads: const and safe to share. Real-time: everything
/// but the construction.
class ArcPath {
 public:
  /// A point of the path with everything the path stores about it.
  struct Place {
    Vec3 position = Vec3::Zero();  ///< [m]
    Vec3 tangent = Vec3::Zero();   ///< unit vector in the direction of the movement; zero on a path without length
    Vec3 force = Vec3::Zero();     ///< expert's force, as recorded; zero if the recording has none [N]
    double speed = 0;              ///< expert's speed at this point, pauses included [m/s]
    double radius = 0;             ///< tunnel radius [m]
  };

  /// Builds an ArcPath from the samples of a movement, in the order of time.
  class Builder {
   public:
    /// Throws Error(input) unless `spacing` [m] is greater than 0 and finite; see spacing_for.
    explicit Builder(double spacing);

    /// Adds the next sample: time strictly after the previous one [s], position [m], force [N]. The movement between
    /// two samples is taken as straight.
    void add(double time, const Vec3& position, const Vec3& force);

    /// Returns the path with the same tunnel radius [m] everywhere. Throws Error(input) when no sample was added.
    ArcPath finish(double radius);

   private:
    void close_segment();

    double spacing_;
    std::vector<Vec3> position_;
    std::vector<double> time_;
    std::vector<Eigen::Vector3f> force_;
    Vec3 last_ = Vec3::Zero(), last_force_ = Vec3::Zero();
    double last_time_ = 0;
    Vec3 impulse_ = Vec3::Zero();  ///< time integral of the force on the current segment [N s]
    double duration_ = 0;          ///< time spent on the current segment [s]
  };

  /// Returns the spacing for a movement whose box has this diagonal [m]: 0.25 mm for desktop devices, less for tiny
  /// paths.
  static double spacing_for(double extent);

  [[nodiscard]] double length() const noexcept { return length_; }      ///< [m]
  [[nodiscard]] double diagonal() const noexcept { return diagonal_; }  ///< of the box around all knots [m]
  [[nodiscard]] double spacing() const noexcept { return spacing_; }
  [[nodiscard]] std::size_t knots() const noexcept { return position_.size(); }
  /// Returns the time at which the expert was at arc length `s` [s], counted from the expert's start.
  [[nodiscard]] double time_at(double s) const noexcept;
  /// Returns the arc length of the expert at `time` [s] after the expert's start [m]. Costs O(log knots).
  [[nodiscard]] double place_at(double time) const noexcept;
  /// Returns the point at arc length `s` [m], clamped to the ends of the path; NaN gives the start.
  [[nodiscard]] Place at(double s) const noexcept;
  [[nodiscard]] Vec3 position_at(double s) const noexcept;
  /// Returns the tunnel radius at arc length `s` [m].
  [[nodiscard]] double radius_at(double s) const noexcept;

  /// Returns the arc length of knot `i` [m].
  [[nodiscard]] double knot_at(std::size_t i) const noexcept {
    return i + 1 < position_.size() ? spacing_ * static_cast<double>(i) : length_;
  }

  /// Sets a radius for every knot [m], each at least 0. Throws Error(input) when a radius is negative or the number
  /// differs.
  void set_radius(const std::vector<double>& radius);

  /// The nearest point on a segment: arc length [m] and squared distance [m^2].
  struct Nearest {
    double s = 0, squared_distance = 0;
  };
  [[nodiscard]] Nearest nearest_on(std::size_t i, const Vec3& point) const noexcept;
  /// Returns the nearest point between two arc lengths, the first of several. Costs O(segments between them).
  [[nodiscard]] Nearest nearest_between(double from, double to, const Vec3& point) const noexcept;
  /// Returns the index of the segment that contains arc length `s`.
  [[nodiscard]] std::size_t segment_at(double s) const noexcept;

 private:
  ArcPath() = default;
  struct Where {
    std::size_t segment = 0;
    double share = 0;  ///< fraction of the segment that lies before the point
  };
  [[nodiscard]] Where where(double s) const noexcept;
  [[nodiscard]] double segment_length(std::size_t i) const noexcept { return knot_at(i + 1) - knot_at(i); }

  double spacing_ = 0, length_ = 0, diagonal_ = 0;
  std::vector<Vec3> position_;
  std::vector<Eigen::Vector3f> force_;  ///< mean over the time on each segment; a path without segments has one
  std::vector<double> time_;
  std::vector<float> radius_;
};

/// Returns whether a movement that came to the arc length `s` [m] arrived at the end of a path of `length` [m]: the
/// last 2 mm, or 5 % of a short path, are not asked for.
[[nodiscard]] bool is_at_end(double s, double length) noexcept;

}  // namespace haptrace
