#include "player/tuning/live_monitor.h"

#include <algorithm>

namespace haptrace {

void LiveMonitor::push(const Sample& sample) noexcept {
  constexpr std::int64_t kPostPeriod = 20'000'000;  // [ns]
  ++status_.samples;
  status_.time = 1e-9 * static_cast<double>(sample.time_ns);
  status_.jitter = std::max(status_.jitter, static_cast<double>(sample.latency));
  status_.phase = sample.phase;
  if (sample.time_ns - posted_ns_ < kPostPeriod) return;

  posted_ns_ = sample.time_ns;
  status_.rate = static_cast<double>(status_.samples - 1) / (status_.time - away_time_);
  status_.force = sample.force.norm();
  status_.deviation = (sample.position - sample.reference_position).norm();
  status_.speed = sample.velocity.norm();
  mailbox_.post(status_);
  status_.jitter = 0;
}

void LiveMonitor::push(const Event& event) noexcept {
  if (event.code == EventCode::overrun) ++status_.overruns;
  if (event.code == EventCode::states_resumed) away_time_ += event.values[0];
  if (event.code != EventCode::device_lost && event.code != EventCode::device_found) return;
  // Posted at once: there are no samples while the device is away.
  status_.away = event.code == EventCode::device_lost;
  if (status_.away)
    ++status_.losses;
  else
    away_time_ += event.values[0];
  status_.force = 0;
  mailbox_.post(status_);
}

}  // namespace haptrace
