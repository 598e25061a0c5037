#include "cli/live_training.h"

#include <chrono>
#include <cstdint>
#include <nlohmann/json.hpp>

namespace haptrace::cli {

LiveTraining::LiveTraining(LiveView& view)
    : view_(view), thread_([this](const std::stop_token& stop) { follow(stop); }) {}

void LiveTraining::ask(const Commands* commands) {
  const std::lock_guard lock(mutex_);
  commands_ = commands;
}

void LiveTraining::change(const std::function<void(TrainingProgress&)>& how) {
  const std::lock_guard lock(mutex_);
  how(progress_);
  send();
}

void LiveTraining::follow(const std::stop_token& stop) {
  constexpr auto kPoll = std::chrono::milliseconds(10);  // a frame of the page takes longer
  std::uint64_t seen = 0;
  while (!stop.stop_requested()) {
    std::this_thread::sleep_for(kPoll);
    const Sample& sample = newest_.latest();
    if (sample.tick == seen) continue;
    seen = sample.tick;
    const std::lock_guard lock(mutex_);
    const bool skipped = sample.phase == Phase::stopped && commands_ != nullptr && commands_->skips();
    if (progress_.observe(sample, skipped)) send();
  }
}

void LiveTraining::send() {
  view_.training(to_json(progress_.screen()));
}

}  // namespace haptrace::cli
