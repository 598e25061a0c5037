/* A point mass of 0.2 kg with 1 N s/m that goes wrong as its options ask:
 *   {"fault": NAME, "tick": N}, where ticks count the exchanges that advance time.
 *     open       refuses to open, with a reason        silent    refuses to open, without one
 *     info       describes an empty workspace          force     has no maximum force
 *     nan        position is not a number at tick N    jump      stands 30 mm further from tick N on
 *     lost       is gone from tick N on                backwards moves against the force
 *     swapped    likewise, and another one every time that it is opened
 *     not_ready  allows no force before tick N         clock     moves by the monotonic clock, not by dt
 *     names      leaves its strings unterminated       measures  measures velocity, orientation and force
 *     leaps      stands at -2e6 m from tick N on       repeats   takes a new sample at every Nth tick only, and says so
 *     mute       takes no new sample from tick N on, and says so
 * WRONG_ABI and MISSING_SYMBOL, when defined, make a library that cannot be used at all. */
#include "devices/plugin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct faulty_device {
  char fault[32];
  long fault_tick, tick, sampled;
  double position[3], velocity[3], sample[3];
  struct timespec last;
} faulty_device;

static int has(const faulty_device* device, const char* fault) {
  return strcmp(device->fault, fault) == 0;
}

uint32_t haptrace_plugin_abi(void) {
#ifdef WRONG_ABI
  return HAPTRACE_PLUGIN_ABI + 1;
#else
  return HAPTRACE_PLUGIN_ABI;
#endif
}

int haptrace_plugin_open(const char* options_json, void** device, haptrace_plugin_info* info, char* error,
                         size_t error_size) {
  if (info->struct_size != sizeof *info) {
    snprintf(error, error_size, "struct_size is %u", info->struct_size);
    return -1;
  }
  faulty_device* opened = calloc(1, sizeof *opened);
  if (!opened) return -1;
  const char* fault = strstr(options_json, "\"fault\":\"");
  if (fault) sscanf(fault + strlen("\"fault\":\""), "%31[a-z_]", opened->fault);
  const char* tick = strstr(options_json, "\"tick\":");
  if (tick) opened->fault_tick = strtol(tick + strlen("\"tick\":"), NULL, 10);
  clock_gettime(CLOCK_MONOTONIC, &opened->last);

  if (has(opened, "open") || has(opened, "silent")) {
    if (has(opened, "open")) snprintf(error, error_size, "the cable is not plugged in");
    free(opened);
    return -3;
  }
  info->flags = has(opened, "clock") ? 0 : 1;
  info->axes = 7;
  snprintf(info->model, sizeof info->model, "faulty mass");
  if (has(opened, "names")) {
    memset(info->model, 'm', sizeof info->model);
    memset(info->serial, 's', sizeof info->serial);
  }
  if (has(opened, "swapped"))
    snprintf(info->serial, sizeof info->serial, "%ld.%09ld", (long)opened->last.tv_sec, opened->last.tv_nsec);
  for (int axis = 0; axis < 3; ++axis) {
    info->workspace_min[axis] = -0.2;
    info->workspace_max[axis] = has(opened, "info") ? -0.2 : 0.2;
  }
  info->max_force = has(opened, "force") ? 0 : 20;
  info->nominal_rate = 1000;
  *device = opened;
  return 0;
}

#ifndef MISSING_SYMBOL
int haptrace_plugin_exchange(void* opaque, double dt, const double wrench[6], haptrace_plugin_state* state) {
  faulty_device* device = opaque;
  if (dt > 0) ++device->tick;
  const int due = device->tick >= device->fault_tick;
  if ((has(device, "lost") || has(device, "swapped")) && due) return -5;

  if (has(device, "clock")) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    dt = (double)(now.tv_sec - device->last.tv_sec) + 1e-9 * (double)(now.tv_nsec - device->last.tv_nsec);
    device->last = now;
  }
  for (int axis = 0; axis < 3; ++axis) {
    const double force = has(device, "backwards") ? -wrench[axis] : wrench[axis];
    device->velocity[axis] = (device->velocity[axis] + dt * force / 0.2) / (1 + dt * 1 / 0.2);
    device->position[axis] += dt * device->velocity[axis];
    state->position[axis] = device->position[axis];
    state->velocity[axis] = has(device, "measures") ? device->velocity[axis] : NAN;
    state->force[axis] = has(device, "measures") ? 0 : NAN;
  }
  for (int i = 0; i < 4; ++i) state->orientation[i] = has(device, "measures") ? i == 0 : NAN;
  state->buttons = 0;
  state->ready = !has(device, "not_ready") || due;
  if (has(device, "nan") && device->tick == device->fault_tick) state->position[1] = NAN;
  if (has(device, "jump") && due) state->position[0] += 0.03;
  if (has(device, "leaps") && due) state->position[0] = -2e6;
  const int repeats =
      (has(device, "repeats") && device->tick % device->fault_tick != 0) || (has(device, "mute") && due);
  if (!repeats) {
    device->sampled = device->tick;
    memcpy(device->sample, state->position, sizeof device->sample);
  }
  memcpy(state->position, device->sample, sizeof device->sample);
  return 0;
}

void haptrace_plugin_sample(void* opaque, haptrace_plugin_sample_info* sample) {
  const faulty_device* device = opaque;
  if (!has(device, "repeats") && !has(device, "mute")) return;
  sample->sequence = 1 + (uint64_t)device->sampled;
  sample->age = 1e-3 * (double)(device->tick - device->sampled); /* at 1000 Hz */
}
#endif

void haptrace_plugin_close(void* device) {
  free(device);
}
