// Commands that every running session obeys, and the log of all its commands.
#pragma once

#include "base/mailbox.h"
#include "base/stop_request.h"
#include "control/sample.h"
#include "player/tuning/commands.h"
#include "player/tuning/session_requests.h"
#include "recorder/annotations.h"

#include <atomic>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

struct DeviceInfo;
struct SessionOptions;

/// Obeys the commands of one line each (docs/tuning.md) that concern a whole session:
///
///     pause, resume, skip, repeat, mark [TEXT], note TEXT, soften, restore, stop, get, get NAME, reset, help, quit
///     first, second: the answer to a question of the programme
///     support 2, support * 1.1: the force that carries the arm [N], in a session that began with one
///
/// A derived class adds quantities, "NAME VALUE". Every effective command adds a notice, a line of the history and, if
/// there are annotations, a mark in the recording: "tuned: kp 2000", "session: pause". As a sink, the object only
/// follows the session's time.
///
/// Threads: any, but only the servo loop reads the mailboxes and pushes.
/// Real-time: push, and latest() of the mailboxes.
class LiveSession : public Commands, public SampleSink {
 public:
  struct Options {
    std::shared_ptr<Annotations> annotations;  ///< receives a mark for every change; may be null
    StopRequest* stop = nullptr;               ///< raised by `stop`; borrowed; null: the session cannot be stopped
    bool programme = false;  ///< pause, skip and repeat concern the repetitions of a programme, which are sessions each
    bool endless = false;    ///< the session repeats until it is stopped
    bool records = false;    ///< the session only records: pause leaves samples out, and there are no repetitions
  };

  /// Share of the feedback forces after `soften`.
  static constexpr double kSoftened = 0.3;
  /// Largest number of repetitions that `repeat` adds to a session.
  static constexpr int kMostRepeats = 100;

  std::string obey(std::string_view command) final;
  [[nodiscard]] std::vector<LiveControl> controls() const final;
  [[nodiscard]] std::vector<std::string> actions() const final;

  /// Adds a notice, from a source of commands without a reader for the answers.
  void tell(std::string notice) final;

  /// Holds the newest requests for the servo loop.
  [[nodiscard]] Mailbox<SessionRequests>& requests() noexcept { return requests_; }
  [[nodiscard]] bool paused() const final;
  [[nodiscard]] bool skips() const final;
  bool attend(bool attended) final;
  /// Returns the wanted share of the feedback forces: 1, or kSoftened after `soften` and while nobody attends.
  [[nodiscard]] double share() const final;

  /// Returns the values in force for a progress line.
  [[nodiscard]] std::string summary() const;

  /// Returns the notices since the last call: changes (of several in a row to the same quantity only the last) and
  /// those passed to tell().
  [[nodiscard]] std::vector<std::string> take_notices();

  /// Returns the object that `get` answers, with "changes": [{"time_s": 1.5, "text": "kp 2000"}, ...], the newest 1000,
  /// and "changed", their total number. In a programme, each has its "recording" too.
  [[nodiscard]] nlohmann::json history() const;

  /// The support of the arm in a session.
  struct CarriedArm {
    double force = 0;     ///< at the beginning [N]
    double most = 0;      ///< [N]
    std::string because;  ///< name of `most`, without an article
  };
  /// Begins a session with this support; nothing: without one. attach() calls it.
  void begin_support(std::optional<CarriedArm> arm);
  /// Returns the support of the next repetition of an exercise: `planned`, or what a command set [N].
  [[nodiscard]] double next_support(std::size_t exercise, double planned);

  /// How a repetition of a programme went on.
  struct TrialEnd {
    bool skipped = false;     ///< a command ended it
    bool unattended = false;  ///< it was softened because nobody attended
  };
  /// A repetition of a programme, as long as it runs. Commands can end it early.
  class Trial {
   public:
    /// The repetition of an exercise begins, which `end` ends early and `file` records. Borrows both objects. `session`
    /// may be null.
    Trial(LiveSession* session, StopRequest& end, std::string file, std::size_t exercise);
    /// The repetition is over, also when it threw.
    ~Trial();
    Trial(const Trial&) = delete;
    Trial& operator=(const Trial&) = delete;
    /// Ends the repetition and returns how it went on; a second call returns the default.
    TrialEnd finish();

   private:
    LiveSession* session_;
  };
  /// In a programme: returns true once if the last repetition is to be done again.
  bool take_repeat();

  /// Asks a question: returns 1 or 2 once it was answered, 0 until then. `asking` false withdraws it.
  int answer_of(bool asking);

  using SampleSink::push;
  void push(const Sample& sample) noexcept override { now_ns_.store(sample.time_ns, std::memory_order_relaxed); }

 protected:
  using Words = std::span<const std::string>;

  explicit LiveSession(Options options);

  // Derived classes answer these with the mutex held. They throw Error(input) when a command has no effect.

  /// Returns the names of all quantities, whether or not this session has them.
  [[nodiscard]] virtual const std::vector<std::string>& quantities() const = 0;
  /// Returns the help about the quantities.
  [[nodiscard]] virtual std::string help() const = 0;
  /// Changes a quantity and returns the answer after "ok ".
  virtual std::string change(const std::string& name, Words values) = 0;
  /// Returns to the values at the start, and returns them: the answer after "ok reset to ". Empty: there are none.
  virtual std::string reset() = 0;
  [[nodiscard]] virtual std::string text_of(const std::string& name) const = 0;
  [[nodiscard]] virtual nlohmann::json state() const = 0;
  [[nodiscard]] virtual std::vector<LiveControl> list_controls() const = 0;
  [[nodiscard]] virtual std::string summarise() const = 0;

  /// Logs a change of `subject`, as in "kp 2000".
  void log_change(const std::string& subject, const std::string& text);
  /// Protects the members of derived classes.
  [[nodiscard]] std::mutex& mutex() const noexcept { return mutex_; }

  // Parts of commands.
  static double finite_number(const std::string& name, const std::string& text);
  /// Reads "* F" or "/ F", and returns the factor; nothing when `values` do not begin so.
  static std::optional<double> factor_of(const std::string& name, Words values);

 private:
  struct Change {
    std::int64_t time_ns = 0;
    std::string text, recording;
  };
  struct Notice {
    std::string text, subject;  ///< a notice replaces the last one if both have the same subject; empty: never
  };

  void begin_trial(StopRequest& end, std::string file, std::size_t exercise);
  TrialEnd end_trial();
  std::string answer(std::string_view command);
  /// Executes a command without a value that concerns the session. Returns an empty text for others.
  std::string act(const std::string& name);
  std::string pause(bool paused);
  std::string skip();
  std::string repeat();
  std::string soften(bool softened);
  std::string answer_with(const std::string& name);
  /// Posts what the servo loop follows. A programme's own pause does not reach it.
  void post();
  /// Posts the share that softening asks for, by command and because nobody attends.
  void post_share();
  /// Throws Error(input) unless the session carries an arm.
  [[nodiscard]] const CarriedArm& arm() const;
  /// Returns the force that the values ask for [N], as a number or as a factor of the `present` one.
  static double wanted_support(Words values, std::optional<double> present);
  std::string change_support(Words values);
  /// Takes a support for a session that has not begun yet, as a file of commands does.
  std::string expect_support(Words values);
  void set_support(double wanted);
  [[nodiscard]] std::string support_text() const;
  /// Resets the support and the quantities of the derived class.
  std::string reset_all();
  std::string annotate(const std::string& name, std::string_view text);
  void log(const std::string& mark, const std::string& text, const std::string& subject);
  void add_notice(Notice notice);
  [[nodiscard]] nlohmann::json whole_state() const;

  const Options options_;
  std::atomic<std::int64_t> now_ns_{0};
  mutable std::mutex mutex_;  ///< protects the members below; of the mailbox only posting
  SessionRequests wanted_;
  Mailbox<SessionRequests> requests_;
  StopRequest* trial_ = nullptr;  ///< ends the present repetition of a programme
  std::string recording_;         ///< of that repetition
  bool skipped_ = false, repeats_ = false;
  bool softened_ = false;  ///< by a command
  bool attended_ = true, unattended_in_trial_ = false;
  bool begun_ = false;  ///< begin_support() was called
  std::optional<CarriedArm> arm_;
  std::size_t exercise_ = 0;
  /// Support of an exercise: as planned, and as a command set it.
  struct ExerciseSupport {
    double planned = 0;
    std::optional<double> changed;
  };
  std::map<std::size_t, ExerciseSupport> supports_;
  bool asks_ = false;  ///< a question waits for its answer
  int answered_ = 0;   ///< 1 or 2; 0: not yet
  int marks_ = 0;
  std::deque<Change> changes_;
  std::size_t changed_ = 0;
  std::deque<Notice> notices_;
};

/// Lets a session on a device follow what `live` asks of its scene and of the support of its arm, and adds its notices
/// to the warnings of the session. `session` holds its plant by then. The controller of the session obeys by itself.
/// Borrows `live`. Throws what plan_support throws.
void attach(LiveSession& live, const DeviceInfo& device, SessionOptions& session, std::vector<SampleSink*>& sinks);

}  // namespace haptrace
