// Plays a circle on a simulated device, to check that the installed library works in a program outside its tree.
#include "haptrace.h"

#include <cstdio>

int main(int argc, char** argv) {
  using namespace haptrace;
  const auto device = open_device("sim:preset=omega3,hand=relaxed,seed=1");
  PlayOptions options;
  if (argc > 1) options.session.recording = SessionOptions::Recording{.file = argv[1]};
  const Path path = make_shape("circle", {.size = 0.04, .duration = 2});
  const PlayResult result = play(*device, plan_playback(device->info(), path, options), options, StopRequest{});
  std::printf("rms error %.3f mm over %llu samples\n", 1e3 * result.last.rms_error,
              static_cast<unsigned long long>(result.last.samples));
  return result.session.servo.cause == StopCause::finished && result.last.samples > 1900 ? 0 : 1;
}
