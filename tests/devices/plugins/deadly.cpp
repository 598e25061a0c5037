// A plug-in for tests that can end or hang its process: a point mass of 0.2 kg on the monotonic clock. Its options are
//   {"fault":NAME,"tick":N}, at exchange N:
//     throws, throws_number   an exception          crashes   a null pointer      aborts   abort()
//     overflows               a stack overflow      exits     exit(0)             hangs    does not return
//     leaves                  _exit(0)
//     stoppable               does not return, but can be stopped
//   and at other times:
//     open_throws, open_exits, open_crashes         close_hangs, close_throws, close_crashes, close_exits
#include "devices/plugin.h"

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <unistd.h>

namespace {

struct Deadly {
  std::string fault;
  long due = 0, tick = 0;
  double position[3] = {}, velocity[3] = {};
};

[[noreturn]] void hang() {
  while (true) std::this_thread::sleep_for(std::chrono::seconds(1));
}

volatile bool has_room = true;

int overflow(volatile char* caller) {
  volatile char room[4096];
  room[0] = *caller;
  return has_room ? overflow(room) + room[0] : 0;
}

// Without the attribute, UndefinedBehaviorSanitizer would report the null pointer instead.
[[gnu::no_sanitize("undefined")]] void crash() {
  int* volatile nowhere = nullptr;
  *nowhere = 1;
}

void fail(const std::string& fault) {
  if (fault == "throws") throw std::runtime_error("the bus is on fire");
  if (fault == "throws_number") throw 42;
  if (fault == "crashes") crash();
  if (fault == "aborts") std::abort();
  if (fault == "exits") std::exit(0);
  if (fault == "leaves") _exit(0);
  if (fault == "hangs" || fault == "stoppable") hang();
  if (fault == "overflows") {
    volatile char begin = 0;
    (void)overflow(&begin);
  }
}

}  // namespace

extern "C" {

uint32_t haptrace_plugin_abi() {
  return HAPTRACE_PLUGIN_ABI;
}

int haptrace_plugin_open(const char* options_json, void** device, haptrace_plugin_info* info, char*, size_t) {
  auto deadly = std::make_unique<Deadly>();
  const std::string options = options_json, key = "\"fault\":\"";
  if (const std::size_t at = options.find(key); at != std::string::npos)
    deadly->fault = options.substr(at + key.size(), options.find('"', at + key.size()) - at - key.size());
  if (const std::size_t at = options.find("\"tick\":"); at != std::string::npos)
    deadly->due = std::strtol(options.c_str() + at + std::strlen("\"tick\":"), nullptr, 10);
  if (deadly->fault == "open_throws") throw std::runtime_error("there is no interpreter");
  if (deadly->fault == "open_exits") std::exit(0);
  if (deadly->fault == "open_crashes") crash();

  info->axes = 7;
  std::snprintf(info->model, sizeof info->model, "deadly mass");
  for (int axis = 0; axis < 3; ++axis) {
    info->workspace_min[axis] = -0.2;
    info->workspace_max[axis] = 0.2;
  }
  info->max_force = 20;
  info->nominal_rate = 1000;
  *device = deadly.release();
  return 0;
}

int haptrace_plugin_exchange(void* opaque, double dt, const double wrench[6], haptrace_plugin_state* state) {
  Deadly& deadly = *static_cast<Deadly*>(opaque);
  if (dt > 0 && ++deadly.tick == deadly.due) fail(deadly.fault);
  for (int axis = 0; axis < 3; ++axis) {
    deadly.velocity[axis] = (deadly.velocity[axis] + dt * wrench[axis] / 0.2) / (1 + dt * 1 / 0.2);
    deadly.position[axis] += dt * deadly.velocity[axis];
    state->position[axis] = deadly.position[axis];
  }
  state->ready = 1;
  return 0;
}

int haptrace_plugin_stop(void* opaque) {
  return static_cast<Deadly*>(opaque)->fault == "stoppable" ? 0 : -1;
}

void haptrace_plugin_close(void* opaque) {
  const std::unique_ptr<Deadly> deadly(static_cast<Deadly*>(opaque));
  if (deadly->fault == "close_hangs") hang();
  if (deadly->fault == "close_crashes") crash();
  if (deadly->fault == "close_exits") std::exit(0);
  if (deadly->fault == "close_throws") throw std::runtime_error("it does not close");
}
}
