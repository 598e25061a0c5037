// Status of a running session for display.
#pragma once

#include "base/mailbox.h"
#include "control/sample.h"
#include "player/session.h"

namespace haptrace {

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
