// Status of a running session for display.
#pragma once

#include "base/mailbox.h"
#include "control/sample.h"

namespace haptrace {

/// Current status of a session.
struct LiveStatus {
  double time = 0;          ///< since the first tick [s]
  double rate = 0;          ///< ticks per second of the session's clock, since the first tick [Hz]
  double jitter = 0;        ///< largest wake-up latency since the last status [s]
  double force = 0;         ///< magnitude sent [N]
  double deviation = kNaN;  ///< distance from the reference [m]
  double speed = 0;         ///< speed of the tool [m/s]
  Phase phase = Phase::idle;
  std::uint64_t samples = 0;
  std::uint64_t overruns = 0;
  std::uint64_t losses = 0;  ///< number of times the device was lost
  bool away = false;         ///< the device is lost
};

/// A sink that posts the current status about fifty times a second.
///
/// Threads: push from the servo loop, latest from one other thread. Real-time: push.
class LiveMonitor final : public SampleSink {
 public:
  void push(const Sample& sample) noexcept override;
  void push(const Event& event) noexcept override;
  [[nodiscard]] LiveStatus latest() noexcept { return mailbox_.latest(); }

 private:
  Mailbox<LiveStatus> mailbox_;
  LiveStatus status_;
  std::int64_t posted_ns_ = 0;
  double away_time_ = 0;  ///< time without the device or its samples [s]
};

}  // namespace haptrace
