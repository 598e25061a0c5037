// Exercises of a programme that have a cue: reaches with force field and error clamp, range of motion, press, tracking,
// weight of an arm.
#pragma once

#include "control/reaching.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

class JsonReader;

/// Consecutive reaches of one kind, as in baseline, field and washout.
struct ReachBlock {
  std::string name;
  int reaches = 1;
  bool field = false;  ///< the exercise's force field acts
  double clamps = 0;   ///< share of error clamps
  double catches = 0;  ///< share of catch trials; only in a block with the field
};

/// From a start to one of several targets, or in their directions. Places are in the coordinates of the exercise.
struct ReachTask {
  ReachGoal goal = ReachGoal::target;
  Vec3 start = Vec3::Zero();      ///< [m]
  std::vector<Vec3> targets;      ///< [m], at least one; of a range and a press, a place in each direction; of a
                                  ///< weight, a place straight below the start
  std::string plane = "xy";       ///< of the lateral deviation and of the field
  double start_radius = 6e-3;     ///< [m]
  double target_radius = 8e-3;    ///< [m]
  double least_start_hold = 0.5;  ///< hold in the start before the cue, drawn between these two [s]
  double most_start_hold = 1;
  double target_hold = 0.5;              ///< hold in the target, or at the farthest place, that ends a reach [s]
  bool pull = false;                     ///< the device leads the hand back to the start
  std::optional<Eigen::Matrix3d> field;  ///< B of F = B v [N s/m]
  double energy = 0.5;                   ///< that field and clamp may give in one reach [J], see ReachForces

  struct Clamp {
    std::optional<double> stiffness;  ///< [N/m]; absent: the stiffest that is stable on the device
    double damping = 3;               ///< [N s/m]
    double break_out = 0.03;          ///< see ClampOptions [m]
  };
  Clamp clamp;                     ///< the lock, in a press and a weight
  bool locked = false;             ///< press: the handle is locked mechanically, and a force sensor measures
  TrackSignal track;               ///< track: movement of the target, as a share of the way to the one target
  std::vector<ReachBlock> blocks;  ///< at least one

  /// Returns the number of reaches of all blocks.
  [[nodiscard]] int reaches() const;
};

/// Returns the time limit of a trial whose exercise states none [s]; a press and tracking last as long.
double usual_time_limit(ReachGoal goal);

/// Reads the object `reach`, `range`, `press`, `track` or `weigh` of an exercise. Without blocks, the task has one
/// block without a name: of `tries` for each target of a range, a press and a weight, else of `repetitions`. `up` is
/// the unit vector upwards. Throws Error(input) naming the key.
ReachTask read_reach_task(JsonReader reader, ReachGoal goal, int repetitions, const Vec3& up);

/// One reach of the schedule.
struct PlannedReach {
  int target = 0;  ///< index into ReachTask::targets
  int block = 0;   ///< index into ReachTask::blocks
  ReachKind kind = ReachKind::plain;
  double start_hold = 0;  ///< [s]

  bool operator==(const PlannedReach&) const = default;
};

/// Returns the geometry and the field of a planned reach. `turn` is the linear part of the exercise's and the
/// participant's changes, orthogonal; `start` and `target` are in W, after those changes [m].
ReachTrial reach_trial(const ReachTask& task, const PlannedReach& planned, const Eigen::Matrix3d& turn,
                       const Vec3& start, const Vec3& target);

/// Returns the direction of a target in the plane of the task, from its first axis towards its second one, 0 to 360
/// [degrees], rounded; NaN for a direction out of the plane.
double angle_of(const ReachTask& task, std::size_t target);
std::string angle_in_words(double angle);  ///< "90 degrees", or "out of the plane"

/// Returns "target 3 of 8, clamp, field", or "direction 3 of 8, 90 degrees": for users, counted from 1.
std::string describe(const ReachTask& task, const PlannedReach& planned);

nlohmann::json json_of(const PlannedReach& planned);
PlannedReach planned_reach_from(JsonReader reader);

/// Returns the object that a recording's config and a session log keep as `reach`, and reads it.
nlohmann::json json_of(const ReachTrial& trial);
ReachTrial reach_trial_from(JsonReader reader);

}  // namespace haptrace
