/* An example of a device plug-in: a point mass with viscous friction, in virtual time.
 *
 *     cc -shared -fPIC -I /usr/include/haptrace mass.c -o mass.so
 *     haptrace record out.h5 --device 'plugin:path=./mass.so,options={"mass":0.5,"viscous":2}' --duration 5
 */
#include "devices/plugin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct mass_device {
  double mass;    /* kg */
  double viscous; /* N s/m */
  double position[3];
  double velocity[3];
} mass_device;

/* The number behind "key" in a flat JSON object. haptrace has checked that the text is JSON. */
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
  mass_device opened = {option(options_json, "mass", 0.2), option(options_json, "viscous", 1), {0, 0, 0}, {0, 0, 0}};
  if (!(opened.mass > 0) || !(opened.viscous >= 0)) {
    snprintf(error, error_size, "mass must be greater than 0 kg and viscous at least 0 N s/m");
    return -1;
  }
  mass_device* mass = malloc(sizeof *mass);
  if (!mass) {
    snprintf(error, error_size, "out of memory");
    return -1;
  }
  *mass = opened;
  *device = mass;

  info->flags = 1; /* virtual time */
  info->axes = 7;  /* force in x, y and z */
  snprintf(info->model, sizeof info->model, "point mass");
  snprintf(info->serial, sizeof info->serial, "%g kg", mass->mass);
  for (int axis = 0; axis < 3; ++axis) {
    info->workspace_min[axis] = -0.2;
    info->workspace_max[axis] = 0.2;
  }
  info->max_force = 20;
  info->nominal_rate = 1000;
  return 0;
}

/* Exact for the constant force of one step: v tends to F / b with the time constant m / b. */
int haptrace_plugin_exchange(void* device, double dt, const double wrench[6], haptrace_plugin_state* state) {
  mass_device* mass = device;
  for (int axis = 0; axis < 3; ++axis) {
    const double force = wrench[axis], v = mass->velocity[axis];
    if (mass->viscous > 0) {
      const double tau = mass->mass / mass->viscous, final = force / mass->viscous, part = -expm1(-dt / tau);
      mass->position[axis] += final * dt + (v - final) * tau * part;
      mass->velocity[axis] = v + (final - v) * part;
    } else {
      mass->position[axis] += (v + 0.5 * force / mass->mass * dt) * dt;
      mass->velocity[axis] = v + force / mass->mass * dt;
    }
    state->position[axis] = mass->position[axis];
    state->velocity[axis] = NAN; /* not measured */
    state->force[axis] = NAN;
  }
  for (int i = 0; i < 4; ++i) state->orientation[i] = NAN;
  state->buttons = 0;
  state->ready = 1;
  return 0;
}

void haptrace_plugin_close(void* device) {
  free(device);
}
