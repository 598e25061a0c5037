// Commands at times of a session, from within it.
#pragma once

#include "player/tuning/live_session.h"
#include "tests/support/not_a_tick.h"

#include <string>
#include <utility>
#include <vector>

namespace haptrace::test {

/// Gives commands at times of the session [s], as another thread would.
class TimedCommands final : public SampleSink {
 public:
  TimedCommands(LiveSession& live, std::vector<std::pair<double, std::string>> commands)
      : live_(live), commands_(std::move(commands)) {}
  using SampleSink::push;
  void push(const Sample& sample) noexcept override {
    const NotATick scope;
    while (next_ < commands_.size() && 1e-9 * static_cast<double>(sample.time_ns) >= commands_[next_].first)
      answers.push_back(live_.obey(commands_[next_++].second));
  }

  std::vector<std::string> answers;

 private:
  LiveSession& live_;
  std::vector<std::pair<double, std::string>> commands_;
  std::size_t next_ = 0;
};

}  // namespace haptrace::test
