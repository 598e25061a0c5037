// Example of a custom controller: a spring to the centre that stiffens with every button press. The program records the
// session. The loop keeps it safe: it applies the limits, the fades and zero force on every exit.
//   sample_spring out.h5 [DEVICE]
#include "haptrace.h"

#include <cstdio>

class Spring final : public haptrace::Controller {
 public:
  haptrace::Command update(const haptrace::State& state) noexcept override {
    const bool pressed = state.buttons != 0;
    if (pressed && !pressed_) stiffness_ *= 1.5;
    pressed_ = pressed;

    haptrace::Command command;
    command.wrench.force = -stiffness_ * state.position - 2 * state.velocity;
    if (state.time_ns >= 5'000'000'000) command.status = haptrace::Command::Status::finished;
    return command;
  }

 private:
  double stiffness_ = 200;  // [N/m]
  bool pressed_ = false;
};

int main(int argc, char** argv) try {
  const auto device = haptrace::open_device(argc > 2 ? argv[2] : "sim:preset=falcon,hand=relaxed");
  Spring spring;
  haptrace::SessionOptions options;
  if (argc > 1)
    options.recording = haptrace::SessionOptions::Recording{.file = argv[1], .options = {.overwrite = true}};
  const auto result = haptrace::run_session(*device, spring, {}, {}, options, haptrace::StopRequest{});
  std::printf("%llu samples, up to %.2f N, %s\n", static_cast<unsigned long long>(result.servo.samples),
              result.servo.max_force, to_string(result.servo.cause));
} catch (const haptrace::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
