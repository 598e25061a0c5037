// clang-format off
/* A device that shares nothing with haptrace's simulator, in virtual time: steps of 20 us of semi-implicit Euler, and
 * what real devices have and models leave out. Its options are numbers, in SI units, and what is not given is benign:
 *
 *   mass, viscous, coulomb, gravity         of each axis; gravity acts downwards
 *   inertia                                 by how much of itself the mass varies over the workspace
 *   cable, cable_period                     amplitude and period of a force that depends on the position
 *   backlash, handle                        half the play between the motor, which has the encoder, and the handle;
 *                                           share of the mass that the handle has
 *   delay                                   number of samples until a force acts
 *   quantum, told_quantum                   of the positions, and what it says of that; 0: nothing
 *   hand_mass, hand_stiffness, hand_damping of a hand that holds the handle and follows it within 0.3 s
 */
// clang-format on
#include "devices/plugin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { axes = 3, most_delay = 64 };

static const double step = 2e-5; /* s */

typedef struct awkward_axis {
  double x, v;         /* of the motor */
  double handle, rate; /* of the handle */
  double bristle;      /* friction force, N */
  double anchor;       /* of the hand */
} awkward_axis;

typedef struct awkward_device {
  double mass, viscous, coulomb, gravity, inertia, cable, cable_period, backlash, handle, quantum;
  double hand_mass, hand_stiffness, hand_damping;
  int delay, oldest;
  double queue[most_delay][axes];
  awkward_axis axis[axes];
} awkward_device;

static double option(const char* json, const char* key, double fallback) {
  char quoted[64];
  snprintf(quoted, sizeof quoted, "\"%s\"", key);
  const char* found = strstr(json, quoted);
  const char* colon = found ? strchr(found, ':') : NULL;
  return colon ? strtod(colon + 1, NULL) : fallback;
}

uint32_t haptrace_plugin_abi(void) {
  return HAPTRACE_PLUGIN_ABI;
}

int haptrace_plugin_open(const char* options_json, void** device, haptrace_plugin_info* info, char* error,
                         size_t error_size) {
  awkward_device* opened = calloc(1, sizeof *opened);
  if (!opened) {
    snprintf(error, error_size, "out of memory");
    return -1;
  }
  opened->mass = option(options_json, "mass", 0.3);
  opened->viscous = option(options_json, "viscous", 1);
  opened->coulomb = option(options_json, "coulomb", 0.4);
  opened->gravity = option(options_json, "gravity", 0);
  opened->inertia = option(options_json, "inertia", 0);
  opened->cable = option(options_json, "cable", 0);
  opened->cable_period = option(options_json, "cable_period", 0.012);
  opened->backlash = option(options_json, "backlash", 0);
  opened->handle = opened->backlash > 0 ? option(options_json, "handle", 0.3) * opened->mass : 0;
  opened->quantum = option(options_json, "quantum", 0);
  opened->hand_mass = option(options_json, "hand_mass", 0);
  opened->hand_stiffness = option(options_json, "hand_stiffness", 0);
  opened->hand_damping = option(options_json, "hand_damping", 0);
  opened->delay = (int)option(options_json, "delay", 0);
  if (opened->delay < 0 || opened->delay >= most_delay || !(opened->mass > 0)) {
    snprintf(error, error_size, "delay must be from 0 to %d samples and mass greater than 0 kg", most_delay - 1);
    free(opened);
    return -1;
  }
  *device = opened;

  info->flags = 1; /* virtual time */
  info->axes = 7;
  snprintf(info->model, sizeof info->model, "awkward device");
  snprintf(info->serial, sizeof info->serial, "1");
  for (int i = 0; i < axes; ++i) {
    info->workspace_min[i] = -0.1;
    info->workspace_max[i] = 0.1;
  }
  info->position_resolution = option(options_json, "told_quantum", 0);
  info->max_force = 10;
  info->max_continuous_force = 10;
  info->nominal_rate = 1000;
  return 0;
}

/* What the handle does to the motor through the play. */
static double through_play(const awkward_device* device, const awkward_axis* axis) {
  const double stiffness = 2e4, damping = 8; /* N/m, N s/m */
  const double apart = axis->handle - axis->x;
  if (fabs(apart) <= device->backlash) return 0;
  return stiffness * (apart - copysign(device->backlash, apart)) + damping * (axis->rate - axis->v);
}

static double of_hand(const awkward_device* device, awkward_axis* axis, double position, double velocity) {
  axis->anchor += step / 0.3 * (position - axis->anchor);
  return device->hand_stiffness * (axis->anchor - position) - device->hand_damping * velocity;
}

static void advance(const awkward_device* device, awkward_axis* axis, double force) {
  const double pi = 3.14159265358979323846, width = 0.05;
  const double base = device->mass - device->handle;
  double mass = base * (1 + device->inertia * sin(axis->x / width));
  const double slope = base * device->inertia / width * cos(axis->x / width);
  force -= 0.5 * slope * axis->v * axis->v + device->viscous * axis->v;
  if (device->cable > 0) force += device->cable * sin(2 * pi * axis->x / device->cable_period);
  if (device->coulomb > 0) { /* Dahl: a bristle of 2e4 N/m */
    const double rate = 2e4 / device->coulomb * fabs(axis->v);
    const double full = copysign(device->coulomb, axis->v);
    axis->bristle = full + (axis->bristle - full) * exp(-rate * step);
    force -= axis->bristle;
  }
  if (device->handle > 0) {
    const double from_handle = through_play(device, axis);
    const double hand = of_hand(device, axis, axis->handle, axis->rate);
    axis->rate += step * (hand - from_handle) / (device->handle + device->hand_mass);
    axis->handle += step * axis->rate;
    force += from_handle;
  } else {
    force += of_hand(device, axis, axis->x, axis->v);
    mass += device->hand_mass;
  }
  axis->v += step * force / mass;
  axis->x += step * axis->v;
}

int haptrace_plugin_exchange(void* opened, double dt, const double wrench[6], haptrace_plugin_state* state) {
  awkward_device* device = opened;
  double force[axes];
  for (int i = 0; i < axes; ++i) force[i] = wrench[i];
  if (device->delay > 0)
    for (int i = 0; i < axes; ++i) {
      double* queued = &device->queue[device->oldest][i];
      const double due = *queued;
      *queued = force[i];
      force[i] = due;
    }
  if (device->delay > 0) device->oldest = (device->oldest + 1) % device->delay;
  force[2] -= device->gravity;

  const long steps = lround(dt / step);
  for (int i = 0; i < axes; ++i) {
    for (long k = 0; k < steps; ++k) advance(device, &device->axis[i], force[i]);
    const double x = device->axis[i].x;
    state->position[i] = device->quantum > 0 ? device->quantum * round(x / device->quantum) : x;
    state->velocity[i] = NAN;
    state->force[i] = NAN;
  }
  for (int i = 0; i < 4; ++i) state->orientation[i] = NAN;
  state->buttons = 0;
  state->ready = 1;
  return 0;
}

void haptrace_plugin_close(void* device) {
  free(device);
}
