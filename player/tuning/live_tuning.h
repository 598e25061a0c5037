// Changes the tuning of a running session by commands, within the limits of the device, and logs every change.
#pragma once

#include "base/mailbox.h"
#include "control/sample.h"
#include "control/tuning.h"
#include "recorder/annotations.h"

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Largest tuning under which a device is stable. Larger requests are clamped to it. The defaults are general bounds
/// that do not depend on a device.
struct TuningLimits {
  PdGains largest{Vec3::Constant(kLargestKp), Vec3::Constant(kLargestKd)};
  double observer_hz = 100;                               ///< the observer's largest bandwidth
  std::string because = "the limit for every device is";  ///< precedes the limit in the answer about a clamped value
};

/// Returns the limits of a device of which only the maximum force [N] is known: ten times its cautious_gains, so that
/// 1.6 mm of deviation reaches the force limit.
TuningLimits limits_of_unidentified(double max_force, double rate_hz);

/// The tuning of a running session, changed by commands of one line each (docs/tuning.md):
///
///     kp 2000              kp 2000 2000 1500     kd 20        gains * 1.1     gains / 1.1
///     observer 0.5         observer on|off|toggle             observer_hz 12
///     inertia, gravity, friction, learning as observer; feedforward: the first three at once
///     get                  get kp                reset        help            quit
///
/// Every effective change adds a notice, a line of the history and, if there are annotations, a mark in the recording:
/// "tuned: kp 2000". As a sink, the object only follows the session's time.
///
/// Threads: any, but only the servo loop reads the mailbox and pushes.
/// Real-time: push, and latest() of the mailbox.
class LiveTuning final : public SampleSink {
 public:
  struct Options {
    TuningLimits limits;
    Compensations composed;
    std::string remedy = "start the session with it";  ///< advice in the error about a missing compensation
    std::shared_ptr<Annotations> annotations;          ///< receives a mark for every change; may be null
  };

  /// Does not clamp `start`: the limits are raised to it. Throws Error(input) when its gains are invalid.
  LiveTuning(const Tuning& start, Options options);

  /// Executes one command and returns a line, both without the line's end: "ok kp 2000 2000 2000" with the value in
  /// force; "ok kp 5200 5200 5200 clamped from 9000: the device is stable up to 5200"; "error ..." (nothing was
  /// changed); for `get` alone a JSON object. Answers are printable ASCII whatever the command. Does not throw for any
  /// command.
  std::string obey(std::string_view command);

  /// Returns the requested tuning. mailbox() holds the newest one for the servo loop.
  [[nodiscard]] Tuning wanted() const;
  [[nodiscard]] Mailbox<Tuning>& mailbox() noexcept { return mailbox_; }

  /// Returns the current gains and shares for a progress line: "kp 2000 kd 20 observer 0.5". Shares of 1 are omitted.
  [[nodiscard]] std::string summary() const;

  /// Returns the notices since the last call: changes (of several in a row to the same quantity only the last) and
  /// those passed to tell(). tell() is for sources of commands without a reader for the answers.
  [[nodiscard]] std::vector<std::string> take_notices();
  void tell(std::string notice);

  /// Returns the object that `get` answers, with "changes": [{"time_s": 1.5, "text": "kp 2000"}, ...], the newest 1000,
  /// and "changed", their total number.
  [[nodiscard]] nlohmann::json history() const;

  using SampleSink::push;
  void push(const Sample& sample) noexcept override { now_ns_.store(sample.time_ns, std::memory_order_relaxed); }

 private:
  struct Change {
    std::int64_t time_ns = 0;
    std::string text;
  };
  struct Notice {
    std::string text, subject;  ///< a notice replaces the last one if both have the same subject; empty: never
  };
  using Words = std::span<const std::string>;

  std::string answer(Words words);
  std::string set_gain(const std::string& name, Words values, Tuning& tuning) const;
  std::string scale_gains(Words values, Tuning& tuning) const;
  std::string set_bandwidth(Words values, Tuning& tuning) const;
  void set_shares(const std::string& name, Words values, Tuning& tuning) const;
  void require_composed(const std::string& name) const;
  [[nodiscard]] std::string text_of(const std::string& name, const Tuning& tuning, bool brief) const;
  [[nodiscard]] nlohmann::json state(const Tuning& tuning) const;
  void put_in_force(const Tuning& tuning, const std::string& subject, const std::string& text);
  void add_notice(Notice notice);

  const Tuning start_;
  const Options options_;
  std::atomic<std::int64_t> now_ns_{0};
  mutable std::mutex mutex_;  ///< protects the members below; of the mailbox only posting
  Tuning wanted_;
  Mailbox<Tuning> mailbox_;
  std::deque<Change> changes_;
  std::size_t changed_ = 0;
  std::deque<Notice> notices_;
};

}  // namespace haptrace
