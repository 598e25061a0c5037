// Number of oscillations that a session reports.
#pragma once

#include "control/sample.h"

namespace haptrace {

/// Counts the events that report an oscillation.
///
/// Real-time: push.
class OscillationCount final : public SampleSink {
 public:
  using SampleSink::push;
  void push(const Sample&) noexcept override {}
  void push(const Event& event) noexcept override {
    if (is_oscillation(event.code)) ++count_;
  }
  [[nodiscard]] int count() const noexcept { return count_; }

 private:
  int count_ = 0;
};

}  // namespace haptrace
