// A session as a trainee and a therapist see it: states, words and scores, without any drawing.
#pragma once

#include "formats/documents/session_log.h"
#include "player/programme/programme_session.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Score of a repetition, as a trainee sees it.
struct TrainingScore {
  double time_in_tunnel = kNaN;  ///< share of the time, 0 to 1
  double time = kNaN;            ///< from the start of the movement to its end [s]
  bool best = false;             ///< better than the trainee's earlier repetitions by more than their spread
};

/// Screen of a trainee.
struct TrainingScreen {
  enum class State {
    waiting,   ///< until the handle is held, or during a pause
    approach,  ///< the device moves to the start
    go,        ///< the movement may begin
    moving,
    done,
    rest,
    question,  ///< which of two places was farther
    skipped,   ///< a command ended the repetition, and the next one follows
    stopped,   ///< a limit, a fault or a stop ended the repetition
    finished,  ///< the session is over
  };

  State state = State::waiting;
  TrainingTrial trial;
  double rest = kNaN;                  ///< time left until the next repetition, or for the answer [s]
  std::optional<TrainingScore> score;  ///< of the last repetition, if it shows one
};

const char* to_string(TrainingScreen::State state);

/// Returns the message `training` of the live view.
nlohmann::json to_json(const TrainingScreen& screen);

/// Returns the score of a repetition, given the trainee's earlier ones of the same exercise in order. Nothing without a
/// time in the tunnel. A repetition is the best if there are at least three earlier ones, and it has more time in the
/// tunnel than any of them and more than their median by over 1.5 median absolute deviations; with as much time in the
/// tunnel as the best, it must be as much faster. A repetition with more help than the best one is not better.
std::optional<TrainingScore> training_score(const LoggedTrial& trial, const std::vector<LoggedTrial>& earlier);

/// Follows the states of a trainee's screen through a session.
///
/// Threads: one at a time. Pure: it has no clock of its own.
class TrainingProgress {
 public:
  /// Movement that ends the state go [m], and the time after which it ends anyway [s].
  static constexpr double kMoved = 2e-3, kLongestGo = 1;

  [[nodiscard]] const TrainingScreen& screen() const noexcept { return screen_; }

  void begin(TrainingTrial trial);
  /// Follows a sample of the session; `skipped`: a repetition that ends now was skipped. Returns true if the state
  /// changed.
  bool observe(const Sample& sample, bool skipped = false);
  /// Ends a repetition of a programme. `earlier` are the trials of the log before it.
  void end(const LoggedTrial& trial, const std::vector<LoggedTrial>& earlier);
  /// Ends a repetition that has no log, as in `guide`: `score` without `best`.
  void end(bool stopped, std::optional<TrainingScore> score);
  /// Rests for `left` more seconds; NaN: paused.
  void rest(double left);
  /// Asks which place was farther, for `left` more seconds.
  void ask(double left);
  /// Ends the session.
  void finish(bool stopped);

 private:
  TrainingScreen screen_;
  std::optional<double> go_since_;  ///< [s]
  Vec3 go_from_ = Vec3::Zero();     ///< [m]
};

/// State of a programme beside its log.
struct ProgrammeProgress {
  std::size_t current = 0;  ///< exercise
  bool paused = false;
  double elapsed = 0;  ///< of this sitting [s]
};

/// Returns the message `programme` of the live view, for a therapist.
nlohmann::json programme_message(const Programme& programme, const SessionLog& log, const ProgrammeProgress& progress);

/// Returns the settings of a repetition in words: "tunnel, radius 5.0 mm".
std::string settings_text(const Exercise& exercise, const TrialSettings& settings);

}  // namespace haptrace
