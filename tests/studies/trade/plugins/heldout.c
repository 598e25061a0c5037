/* Plants that nothing in haptrace was tuned for, in virtual time: masses that are coupled, friction of three kinds,
 * transport delay and motor lag, a hand behind a grip, and noise of another spectrum than the simulator's. They share
 * no code with the simulator. Options, a flat JSON object:
 *   mass, coupling (share of it, off the diagonal), viscous, coulomb, friction (0 smooth, 1 bristle, 2 Stribeck),
 *   delay (s), lag (s), gravity, quantum (m), jitter (m rms), force, axes (3 or 1),
 *   hand (kg, 0: none), grip (N/m), arm (N/m), tremor (N rms), band (Hz), drift (N rms), seed */
#include "devices/plugin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { kSubsteps = 20, kDelayed = 4096 };

typedef struct heldout {
  double mass, coupling, viscous, coulomb, delay, lag, gravity, quantum, jitter, force;
  double hand, grip, arm, tremor, band, drift;
  int friction, axes;
  double inverse[3][3];
  double x[3], v[3], bristle[3], motor[3], hx[3], hv[3], shake[3][2], wander[3], now;
  double sent[kDelayed][3], sent_at[kDelayed];
  unsigned newest, oldest;
  unsigned long long state;
} heldout;

static double option(const char* json, const char* key, double fallback) {
  char quoted[64];
  snprintf(quoted, sizeof quoted, "\"%s\"", key);
  const char* found = strstr(json, quoted);
  const char* colon = found ? strchr(found, ':') : NULL;
  return colon ? strtod(colon + 1, NULL) : fallback;
}

/* xorshift64*, summed to nearly normal deviates of variance 1. */
static double noise(heldout* d) {
  double sum = 0;
  for (int i = 0; i < 12; ++i) {
    d->state ^= d->state >> 12;
    d->state ^= d->state << 25;
    d->state ^= d->state >> 27;
    sum += (double)((d->state * 0x2545f4914f6cdd1dULL) >> 11) / 9007199254740992.0;
  }
  return sum - 6;
}

/* The inverse of m ((1 - c) I + c ones). */
static void invert(heldout* d) {
  const double c = d->coupling, m = d->mass;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) d->inverse[i][j] = ((i == j ? 1.0 : 0.0) - c / (1 + 2 * c)) / (m * (1 - c));
}

uint32_t haptrace_plugin_abi(void) {
  return HAPTRACE_PLUGIN_ABI;
}

int haptrace_plugin_open(const char* json, void** device, haptrace_plugin_info* info, char* error, size_t error_size) {
  heldout* d = calloc(1, sizeof *d);
  if (!d) {
    snprintf(error, error_size, "out of memory");
    return -1;
  }
  d->mass = option(json, "mass", 0.3);
  d->coupling = option(json, "coupling", 0);
  d->viscous = option(json, "viscous", 1);
  d->coulomb = option(json, "coulomb", 0.4);
  d->friction = (int)option(json, "friction", 1);
  d->delay = option(json, "delay", 1e-3);
  d->lag = option(json, "lag", 5e-4);
  d->gravity = option(json, "gravity", 0.5);
  d->quantum = option(json, "quantum", 3e-5);
  d->jitter = option(json, "jitter", 0);
  d->force = option(json, "force", 9);
  d->axes = (int)option(json, "axes", 3);
  d->hand = option(json, "hand", 0.12);
  d->grip = option(json, "grip", 600);
  d->arm = option(json, "arm", 40);
  d->tremor = option(json, "tremor", 0.05);
  d->band = option(json, "band", 9);
  d->drift = option(json, "drift", 0.12);
  d->state = 0x9e3779b97f4a7c15ULL * (unsigned long long)(1 + option(json, "seed", 1));
  if (d->axes == 1) d->coupling = 0;
  invert(d);
  *device = d;
  info->flags = 1;
  info->axes = d->axes == 1 ? 1 : 7;
  snprintf(info->model, sizeof info->model, "held-out plant");
  snprintf(info->serial, sizeof info->serial, "%g", d->mass);
  for (int i = 0; i < 3; ++i) {
    const double reach = i < d->axes ? 0.08 : 0.005;
    info->workspace_min[i] = -reach;
    info->workspace_max[i] = reach;
  }
  info->position_resolution = d->quantum;
  info->max_force = d->force;
  info->nominal_rate = 1000;
  return 0;
}

static double friction_of(heldout* d, int i, double h) {
  const double v = d->v[i];
  if (d->friction == 0) return d->coulomb * tanh(v / 2e-3);
  double level = d->coulomb;
  if (d->friction == 2) level *= 1 + 0.3 * exp(-(v * v) / (8e-3 * 8e-3));
  /* Dahl: the bristle stretches to `level` over 60 um. */
  const double stiffness = level / 6e-5;
  d->bristle[i] += h * v * (1 - stiffness * d->bristle[i] * (v > 0 ? 1 : -1) / level);
  return stiffness * d->bristle[i];
}

static void step(heldout* d, double h) {
  while (d->oldest + 1 < d->newest && d->sent_at[(d->oldest + 1) % kDelayed] + d->delay <= d->now) ++d->oldest;
  const int arrived = d->newest > 0 && d->sent_at[d->oldest % kDelayed] + d->delay <= d->now;
  double total[3];
  for (int i = 0; i < 3; ++i) {
    const double commanded = arrived ? d->sent[d->oldest % kDelayed][i] : 0;
    d->motor[i] = d->lag > 0 ? d->motor[i] + h / d->lag * (commanded - d->motor[i]) : commanded;
    total[i] = d->motor[i] - d->viscous * d->v[i] - friction_of(d, i, h);
    if (i == 2) total[i] -= d->gravity * (1 + 5 * d->x[0]);
    if (d->hand > 0) {
      /* A resonator driven by white noise: tremor; a slow first-order one: drift. */
      const double w = 6.283185307179586 * d->band, z = 0.15;
      d->shake[i][1] +=
          h * (-2 * z * w * d->shake[i][1] - w * w * d->shake[i][0]) + 2 * w * sqrt(z * w * h) * d->tremor * noise(d);
      d->shake[i][0] += h * d->shake[i][1];
      d->wander[i] += -h * 3 * d->wander[i] + sqrt(6 * h) * d->drift * noise(d);
      const double contact = d->grip * (d->x[i] - d->hx[i]) + 4 * (d->v[i] - d->hv[i]);
      total[i] -= contact;
      d->hv[i] += h / d->hand * (contact - d->arm * d->hx[i] - 2 * d->hv[i] + d->shake[i][0] + d->wander[i]);
      d->hx[i] += h * d->hv[i];
    }
  }
  for (int i = 0; i < d->axes; ++i) {
    double acceleration = 0;
    for (int j = 0; j < 3; ++j) acceleration += d->inverse[i][j] * total[j];
    d->v[i] += h * acceleration;
  }
  for (int i = 0; i < d->axes; ++i) d->x[i] += h * d->v[i];
  d->now += h;
}

int haptrace_plugin_exchange(void* device, double dt, const double wrench[6], haptrace_plugin_state* state) {
  heldout* d = device;
  double size = sqrt(wrench[0] * wrench[0] + wrench[1] * wrench[1] + wrench[2] * wrench[2]);
  const double share = size > d->force ? d->force / size : 1;
  for (int i = 0; i < 3; ++i) d->sent[d->newest % kDelayed][i] = share * wrench[i];
  d->sent_at[d->newest++ % kDelayed] = d->now;
  if (dt > 0)
    for (int i = 0; i < kSubsteps; ++i) step(d, dt / kSubsteps);
  for (int i = 0; i < 3; ++i) {
    const double x = d->x[i] + d->jitter * (d->jitter > 0 ? noise(d) : 0);
    state->position[i] = i < d->axes ? (d->quantum > 0 ? d->quantum * floor(x / d->quantum + 0.5) : x) : 0;
    state->velocity[i] = state->force[i] = NAN;
  }
  for (int i = 0; i < 4; ++i) state->orientation[i] = NAN;
  state->buttons = 0;
  state->ready = 1;
  return 0;
}

void haptrace_plugin_close(void* device) {
  free(device);
}
