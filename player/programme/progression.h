// How an exercise adapts to a person: how much he is helped, and how hard it is made.
#pragma once

#include "formats/documents/session_log.h"
#include "metrics/recorded_trial.h"

#include <deque>
#include <optional>

namespace haptrace {

/// What is missing to the target, as a share of it: 0 where the figure is as good or better, 1 at most, and 1 when
/// there was nothing to measure.
double shortfall(const Progression& progression, std::optional<double> figure);

/// Where one exercise stands. After a repetition with shortfall e:
///
///     assistance   a <- forget a + gain e,  within 0 and 1
///
/// the law of assist-as-needed (Emken, Benitez and Reinkensmeyer 2007): who needs no help loses it by the factor
/// `forget` a repetition, faster than he learns, and so cannot rest on it; an error within the target counts as none,
/// so that help goes to zero;
///
///     difficulty   level <- level + step  when the median of e over `window` repetitions is 0,
///                           level - step  when it is beyond the tolerance,  within 0 and 1
///
/// each time counting repetitions anew (performance-based progression, Krebs and others 2003). Radius, stiffness and
/// pace follow the level, from easy to hard.
///
/// A pure function of what it was told: a session that is resumed tells it all again.
class ProgressionState {
 public:
  explicit ProgressionState(const Exercise& exercise);

  /// Of the next repetition.
  [[nodiscard]] TrialSettings settings() const;

  /// A repetition was done. One that did not come to its end in time has failed, whatever its figures are: who does not
  /// move is nowhere far from the path.
  void learn(const LoggedTrial& trial);

 private:
  void learn(double shortfall);

  const Exercise* exercise_;  ///< borrowed
  double assistance_ = 1, level_ = 0;
  std::deque<double> shortfalls_;  ///< at this level
};

/// Whether `figures`, of repetitions of one exercise in the order of one sitting, say that the person is tired: the
/// last `repetitions` were all worse than the best of all.
bool is_tired(const ProgrammeLimits::Fatigue& fatigue, const std::vector<nlohmann::json>& figures);

/// Throws Error(input) naming the key when a programme goes by a figure that there is not, or that is neither better
/// nor worse when there is more of it.
void check_figures(const Programme& programme, const std::string& where);

}  // namespace haptrace
