// Results of an assessment over all its trials: the best of the tries in each direction, or means.
#pragma once

#include "formats/documents/session_log.h"
#include "metrics/named_result.h"

#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// The tries in one direction of a range of motion or a press.
struct DirectionSummary {
  double angle = 0;            ///< in the plane of the exercise, see angle_of() [degrees]
  std::size_t tries = 0;       ///< with a metric
  std::optional<double> best;  ///< largest distance [m] or force [N]
  bool at_limit = false;       ///< of the best one: the person may be capable of more
};

/// Results of an exercise in mode range, press, track or weigh. Trials by a person who steered a simulated hand, and
/// those that were softened because nobody attended, do not count.
struct AssessmentSummary {
  ReachGoal goal = ReachGoal::range;
  std::size_t trials = 0;                    ///< with a metric
  std::vector<DirectionSummary> directions;  ///< one for each target of a range and a press
  /// Area of the convex hull of the best places of a range, projected on the plane of the exercise, if they are at
  /// least three [m^2]. With a direction at a limit, the person's area may be larger.
  std::optional<double> area;
  std::optional<double> rms, gain, delay;  ///< tracking: means over the trials [m], [1], [s]
  std::optional<double> weight;            ///< of the arm: mean over the trials [N]
  bool heavier = false;                    ///< the arm may be heavier

  /// Returns true if any direction is at a limit, or the weight.
  [[nodiscard]] bool at_limit() const;
};

/// Returns the results of exercise `i`; nothing if it is in another mode.
std::optional<AssessmentSummary> summarise_assessment(const Programme& programme, std::size_t i, const SessionLog& log);

/// Weight of an arm that a sitting measured.
struct ArmWeight {
  double weight = 0;        ///< mean over the trials in mode weigh [N]
  bool is_earlier = false;  ///< of a sitting before the last one of the log
};

/// Returns the weight of the newest sitting that measured one; nothing without one.
std::optional<ArmWeight> weight_of_arm(const Programme& programme, const SessionLog& log);

nlohmann::json to_json(const AssessmentSummary& summary);

/// Returns all results.
std::vector<NamedResult> results_of(const AssessmentSummary& summary);

/// Returns lines for users: the results and the number of tries.
std::vector<std::string> describe(const AssessmentSummary& summary);

}  // namespace haptrace
