// Changes the tuning of a running session by commands, within the limits of the device, and logs every change.
#pragma once

#include "base/mailbox.h"
#include "control/tuning.h"
#include "player/tuning/live_session.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// Largest tuning under which a device is stable. Larger requests are clamped to it. The defaults are general bounds
/// that do not depend on a device.
struct TuningLimits {
  PdGains largest{Vec3::Constant(kLargestKp), Vec3::Constant(kLargestKd)};
  double observer_hz = 100;                        ///< the observer's largest bandwidth
  std::string because = "limit for every device";  ///< names the limits, without an article
};

/// Returns the limits of a device of which only the maximum force [N] is known: ten times its cautious_gains, so that
/// 1.6 mm of deviation reaches the force limit.
TuningLimits limits_of_unidentified(double max_force, double rate_hz);

/// The tuning of a running playback, changed by commands of one line each (docs/tuning.md), and the commands of every
/// session (LiveSession):
///
///     kp 2000              kp 2000 2000 1500     kd 20        gains * 1.1     gains / 1.1
///     observer 0.5         observer on|off|toggle             observer_hz 12
///     inertia, gravity, friction, learning as observer; feedforward: the first three at once
class LiveTuning final : public LiveSession {
 public:
  struct Options {
    TuningLimits limits;
    Compensations composed;
    std::string remedy = "start the session with it";  ///< advice in the error about a missing compensation
    std::shared_ptr<Annotations> annotations;          ///< receives a mark for every change; may be null
    StopRequest* stop = nullptr;                       ///< see LiveSession::Options
    bool endless = false;                              ///< see LiveSession::Options
  };

  /// Does not clamp `start`: the limits are raised to it. Throws Error(input) when its gains are invalid.
  LiveTuning(const Tuning& start, Options options);

  /// Returns the requested tuning. mailbox() holds the newest one for the servo loop.
  [[nodiscard]] Tuning wanted() const;
  [[nodiscard]] Mailbox<Tuning>& mailbox() noexcept { return mailbox_; }
  /// Returns true once a command has changed the tuning.
  [[nodiscard]] bool changed() const;

 private:
  [[nodiscard]] const std::vector<std::string>& quantities() const override;
  [[nodiscard]] std::string help() const override;
  std::string change(const std::string& name, Words values) override;
  std::string reset() override;
  [[nodiscard]] std::string text_of(const std::string& name) const override { return text_of(name, wanted_, false); }
  [[nodiscard]] nlohmann::json state() const override { return state(wanted_); }
  [[nodiscard]] std::vector<LiveControl> list_controls() const override;
  /// Shares of 1 are omitted: "kp 2000 kd 20 observer 0.5".
  [[nodiscard]] std::string summarise() const override;

  std::string set_gain(const std::string& name, Words values, Tuning& tuning) const;
  std::string scale_gains(Words values, Tuning& tuning) const;
  std::string set_bandwidth(Words values, Tuning& tuning) const;
  void set_shares(const std::string& name, Words values, Tuning& tuning) const;
  void require_composed(const std::string& name) const;
  [[nodiscard]] std::string text_of(const std::string& name, const Tuning& tuning, bool brief) const;
  [[nodiscard]] nlohmann::json state(const Tuning& tuning) const;
  void put_in_force(const Tuning& tuning, const std::string& subject, const std::string& text);

  const Tuning start_;
  const Options options_;
  Tuning wanted_;
  bool changed_ = false;
  Mailbox<Tuning> mailbox_;
};

}  // namespace haptrace
