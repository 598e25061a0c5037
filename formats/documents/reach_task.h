// Reaching exercises of a programme: places, force field, error clamp and blocks.
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

/// Reaching from a start to one of several targets and holding there. Places are in the coordinates of the exercise.
struct ReachTask {
  static constexpr double kTimeLimit = 3;  ///< of a reach whose exercise states none [s]

  Vec3 start = Vec3::Zero();      ///< [m]
  std::vector<Vec3> targets;      ///< [m], at least one
  std::string plane = "xy";       ///< of the lateral deviation and of the field
  double start_radius = 6e-3;     ///< [m]
  double target_radius = 8e-3;    ///< [m]
  double least_start_hold = 0.5;  ///< hold in the start before the cue, drawn between these two [s]
  double most_start_hold = 1;
  double target_hold = 0.5;              ///< hold in the target that ends a reach [s]
  bool pull = false;                     ///< the device leads the hand back to the start
  std::optional<Eigen::Matrix3d> field;  ///< B of F = B v [N s/m]
  double energy = 0.5;                   ///< that field and clamp may give in one reach [J], see ReachForces

  struct Clamp {
    std::optional<double> stiffness;  ///< [N/m]; absent: the stiffest that is stable on the device
    double damping = 3;               ///< [N s/m]
    double break_out = 0.03;          ///< see ClampOptions [m]
  };
  Clamp clamp;
  std::vector<ReachBlock> blocks;  ///< at least one

  /// Returns the number of reaches of all blocks.
  [[nodiscard]] int reaches() const;
};

/// Reads the object `reach` of an exercise. Without blocks, the task has one block of `repetitions` reaches without a
/// name. Throws Error(input) naming the key.
ReachTask read_reach_task(JsonReader reader, int repetitions);

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

/// Returns "target 3 of 8, clamp, field": for users, counted from 1.
std::string describe(const ReachTask& task, const PlannedReach& planned);

nlohmann::json json_of(const PlannedReach& planned);
PlannedReach planned_reach_from(JsonReader reader);

/// Returns the object that a recording's config and a session log keep as `reach`, and reads it.
nlohmann::json json_of(const ReachTrial& trial);
ReachTrial reach_trial_from(JsonReader reader);

}  // namespace haptrace
