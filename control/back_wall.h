// Back wall: help along the path for a trainee who does not start, or does not continue.
#pragma once

#include "control/guidance_options.h"
#include "control/guide_term.h"
#include "control/initiation.h"
#include "control/path/arc_path.h"

#include <cstddef>
#include <memory>
#include <vector>

namespace haptrace {

/// A wall that travels along the path and pushes a hand that is behind it (Krebs and others, Autonomous Robots 15:7,
/// 2003):
///
///     f = min(k (s_b - s)+, f_max) along the tangent,   s: arc length of the hand
///
/// The wall waits at the start of the path and wherever the expert stopped, without pushing from the start. It leaves
/// when the trainee does, or after `wait`. The trainee has left when they were faster than kOnsetSpeed for kOnsetTime,
/// or came kOnsetWay beyond the place. From there, s_b passes through the expert's places in the expert's time, times
/// the pace. It stays within f_max / k of the hand: else the push would last beyond the hand's next movement.
///
/// When the force of the approach goes, within kForceGoes, an arm gives way by up to 20 mm without any intention. Such
/// a recoil is no start: it comes to rest, for kComesToRest, within kRecoils and kRecoilWay, and the place where it
/// ends is the one from which the trainee leaves. A hand that is still under way then has left when it began to move.
///
/// A trainee who starts in time and is as fast as the wall feels exactly no force. The work is that of the commanded
/// force; it does not account for the device's delay.
///
/// Real-time: all but the constructor. Threads: one at a time.
class BackWall final : public GuideTerm {
 public:
  static constexpr double kOnsetSpeed = 20e-3;   ///< [m/s]
  static constexpr double kOnsetTime = 0.06;     ///< three times the window of the measured speed [s]
  static constexpr double kOnsetWay = 5e-3;      ///< [m]
  static constexpr double kShortestStop = 0.25;  ///< shorter stops of the expert do not count [s]
  static constexpr double kForceGoes = 0.35;     ///< [s]
  static constexpr double kComesToRest = 0.1;    ///< [s]
  static constexpr double kRecoils = 0.8;        ///< longest recoil from the beginning of a repetition [s]
  static constexpr double kRecoilWay = 0.03;     ///< farthest [m]

  static constexpr double kRelease = 0.2;  ///< [s]

  /// Finds the expert's stops: stretches below 5 mm/s and 5 % of the largest speed. O(knots). Throws Error(input) that
  /// names the option that is out of range.
  BackWall(std::shared_ptr<const ArcPath> path, const BackWallOptions& options);

  /// Starts a repetition.
  void begin() noexcept;
  /// Moves the wall for a hand at `position` [m] with this foot, `dt` [s] after the last update. Precedes force().
  void update(const PathProjection::Foot& foot, const Vec3& position, double dt) noexcept;
  /// Releases the hand within kRelease, for `dt` [s] in which no repetition runs.
  void rest(double dt) noexcept;
  /// Takes the part of the last force that was sent, for its work.
  void acted(double share) noexcept { acted_ = share * force_; }

  [[nodiscard]] Kind kind() const noexcept override { return Kind::active; }
  [[nodiscard]] Vec3 force(const GuideInput& input) noexcept override;
  [[nodiscard]] double allowance(const PathProjection::Foot&, const GuideTuning& tuning) const noexcept override {
    return tuning.assist * options_.max_force;
  }

  [[nodiscard]] const Initiation& initiation() const noexcept { return initiation_; }
  /// Returns the arc length of the wall [m].
  [[nodiscard]] double place() const noexcept { return place_; }

 private:
  /// A place where the expert stopped.
  struct Stop {
    double s = 0;       ///< [m]
    double leaves = 0;  ///< when the expert left it [s]
  };
  void find_stops();
  [[nodiscard]] const Stop& stop() const noexcept { return stops_[next_ - 1]; }
  /// Returns true as soon as the hand's recoil is over.
  bool settles(const PathProjection::Foot& foot, double dt) noexcept;
  /// Returns true while the hand is under way from the last stop.
  bool moves(const PathProjection::Foot& foot, double dt) noexcept;
  void travel(double reach, double dt) noexcept;

  std::shared_ptr<const ArcPath> path_;
  BackWallOptions options_;
  std::vector<Stop> stops_;  ///< the first one is the start
  std::size_t next_ = 1;     ///< next stop
  bool waits_ = true, pushes_ = false, pushed_ = false;
  bool settled_ = false;              ///< the recoil after the approach is over
  double waited_ = 0, fast_for_ = 0;  ///< at the last stop [s]
  double still_for_ = 0;              ///< before the recoil is over [s]
  double from_ = 0;                   ///< place of the hand from which its progress counts [m]
  double time_ = 0;                   ///< the expert's, at the wall [s]
  double place_ = 0, push_ = 0;       ///< s_b [m], f [N]
  Vec3 force_ = Vec3::Zero(), acted_ = Vec3::Zero(), position_ = Vec3::Zero();
  bool begun_ = false;
  Initiation initiation_;
};

}  // namespace haptrace
