// A controller made from a function.
#pragma once

#include "control/controller.h"

#include <functional>
#include <utility>

namespace haptrace::test {

/// Calls a test's function in every tick.
class Scripted final : public Controller {
 public:
  explicit Scripted(std::function<Command(const State&)> script) : script_(std::move(script)) {}
  [[nodiscard]] Command update(const State& state) noexcept override { return script_(state); }

 private:
  std::function<Command(const State&)> script_;
};

}  // namespace haptrace::test
