// Adaptation of an exercise's assistance and difficulty to the participant.
#pragma once

#include "formats/documents/session_log.h"
#include "metrics/recorded_trial.h"

#include <deque>
#include <optional>

namespace haptrace {

/// Returns the shortfall of a metric as a share of its target, 0 to 1: 0 if the target is reached, 1 if there was
/// nothing to measure.
double shortfall(const Progression& progression, std::optional<double> figure);

/// Assistance and difficulty of one exercise. After a repetition with shortfall e:
///
///     assistance   a <- forget a + gain e,  within 0 and 1
///
/// This is the assist-as-needed law (Emken, Benitez and Reinkensmeyer 2007): a participant who needs no help loses it
/// by the factor `forget` per repetition, faster than they learn, and so cannot rely on it. A metric within the target
/// counts as no shortfall, so that the assistance decays to zero.
///
///     difficulty   level <- level + step  when the median of e over `window` repetitions is 0,
///                           level - step  when it is beyond the tolerance,  within 0 and 1
///
/// A change of level restarts the window (performance-based progression, Krebs and others 2003). Radius, stiffness and
/// pace follow the level, from easy to hard.
///
/// The state depends only on the learned trials. A resumed session learns them all again.
class ProgressionState {
 public:
  explicit ProgressionState(const Exercise& exercise);

  /// Returns the settings of the next repetition.
  [[nodiscard]] TrialSettings settings() const;

  /// Updates the state after a repetition. A repetition that did not end in time has failed, whatever its metrics are:
  /// a participant who does not move stays close to the path.
  void learn(const LoggedTrial& trial);

 private:
  void learn(double shortfall);

  const Exercise* exercise_;  ///< borrowed
  double assistance_ = 1, level_ = 0;
  std::deque<double> shortfalls_;  ///< shortfalls at this level
};

/// Returns true when the metrics of one exercise in one sitting, in order, indicate fatigue: each of the last
/// `repetitions` is worse than the best of all by more than the share `worse`.
bool is_tired(const ProgrammeLimits::Fatigue& fatigue, const std::vector<nlohmann::json>& figures);

/// Throws Error(input) that names the key when a programme uses an unknown metric, or one of which neither more nor
/// less is better.
void check_figures(const Programme& programme, const std::string& where);

}  // namespace haptrace
