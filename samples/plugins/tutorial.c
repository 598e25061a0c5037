#include "devices/plugin.h"
#include "slider_board.h"

#include <stdio.h>

static const double kMetresPerCount = 5e-5, kCountsPerNewton = 200;

uint32_t haptrace_plugin_abi(void) {
  return HAPTRACE_PLUGIN_ABI;
}

int haptrace_plugin_open(const char* options, void** device, haptrace_plugin_info* info, char* error, size_t size) {
  char port[32] = "sim0";
  sscanf(options, "{\"port\":\"%31[^\"]", port); /* else as it is */
  slider_board* board = slider_open(port);
  if (!board) {
    snprintf(error, size, "no board answers at port '%s'; is its cable in, and nobody else using it?", port);
    return -1;
  }
  int32_t serial = 0;
  slider_read(board, SLIDER_SERIAL, &serial);
  slider_write(board, SLIDER_WATCHDOG_MS, 20); /* our last force must not outlive us */
  slider_write(board, SLIDER_HOME, 1);
  *device = board;
  info->axes = 1; /* bit 0: a motor along x */
  snprintf(info->model, sizeof info->model, "lab slide");
  snprintf(info->serial, sizeof info->serial, "%d", (int)serial);
  for (int axis = 0; axis < 3; ++axis) info->workspace_max[axis] = axis == 0 ? 0.1 : 0.005;
  for (int axis = 0; axis < 3; ++axis) info->workspace_min[axis] = -info->workspace_max[axis];
  info->position_resolution = kMetresPerCount;
  info->max_force = 5;
  info->nominal_rate = 1000;
  return 0;
}

int haptrace_plugin_exchange(void* device, double dt, const double wrench[6], haptrace_plugin_state* state) {
  (void)dt; /* real time passes by itself */
  int32_t motor = (int32_t)(kCountsPerNewton * wrench[0]), counts = 0, status = 0;
  if (slider_write(device, SLIDER_MOTOR, motor) < 0 || slider_read(device, SLIDER_ENCODER, &counts) < 0 ||
      slider_read(device, SLIDER_STATUS, &status) < 0)
    return -1; /* lost, for good */
  state->position[0] = kMetresPerCount * counts;
  state->ready = status == SLIDER_HOMED; /* homed, and not stopped */
  return 0;
}

void haptrace_plugin_close(void* device) {
  slider_write(device, SLIDER_MOTOR, 0);
  slider_close(device);
}
