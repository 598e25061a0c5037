/* The plug-in ABI: a device of your own in one C file, loaded with
 *
 *     haptrace record out.h5 --device plugin:path=./libmine.so,options={"port":"/dev/ttyACM0"}
 *
 * For C and C++. Units are SI. Positions are p_WT and forces act on the hand, both in the device's base frame W.
 * haptrace calls one function at a time, except for haptrace_plugin_stop. The servo loop calls `exchange`, which must
 * not block and must return well within a tick. A device with slow I/O owns a thread and exchanges the newest values
 * with it. docs/plugins.md explains step by step how to write a plug-in. */
#ifndef HAPTRACE_DEVICES_PLUGIN_H
#define HAPTRACE_DEVICES_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HAPTRACE_PLUGIN_ABI 1

typedef struct haptrace_plugin_info {
  uint32_t struct_size; /* set by the caller: sizeof its declaration */
  uint32_t flags;       /* bit 0: virtual time, the device advances only by the dt of exchange */
  uint32_t axes;        /* bits 0..2 force x,y,z; bits 3..5 torque x,y,z */
  uint32_t reserved;
  char model[64];
  char serial[64];
  double workspace_min[3];     /* m */
  double workspace_max[3];     /* m */
  double position_resolution;  /* m, 0 when unknown */
  double max_force;            /* N, magnitude */
  double max_continuous_force; /* N, magnitude, 0 when unknown */
  double nominal_rate;         /* Hz */
} haptrace_plugin_info;

/* Before every exchange haptrace sets it to zeros (not ready), and to NaN where NaN means "not measured". */
typedef struct haptrace_plugin_state {
  double position[3];    /* m */
  double velocity[3];    /* m/s, NaN when not measured */
  double orientation[4]; /* w,x,y,z, NaN when not measured */
  double force[3];       /* N, measured contact force, NaN when not measured */
  uint32_t buttons;
  uint32_t ready; /* 1 when homed and forces are allowed */
} haptrace_plugin_state;

/* Returns HAPTRACE_PLUGIN_ABI. */
uint32_t haptrace_plugin_abi(void);

/* Opens the device and fills *device and *info. Returns 0, or a negative number with the reason in `error`. */
int haptrace_plugin_open(const char* options_json, void** device, haptrace_plugin_info* info, char* error,
                         size_t error_size);

/* Applies `wrench` (N, N m) from now on, advances a virtual-time device by dt seconds under it, and fills *state with
 * the newest state. The first exchange of a session has dt = 0. Returns 0, or a negative number if the device is
 * lost. */
int haptrace_plugin_exchange(void* device, double dt, const double wrench[6], haptrace_plugin_state* state);

/* Optional: identifies the sample that the last exchange returned. If a plug-in exports haptrace_plugin_sample,
 * haptrace calls it right after every exchange that returned 0, in the same thread and under the same rules. haptrace
 * then distinguishes new samples from repeated ones: it neither records nor controls a repeated state, it computes
 * velocities from the samples' own times, and it fades the force to zero when no new sample comes for 20 ms (three
 * ticks if those are longer). Without it every exchange counts as a new sample, taken at that moment. */
typedef struct haptrace_plugin_sample_info {
  uint32_t struct_size; /* set by the caller: sizeof its declaration */
  uint32_t reserved;
  uint64_t sequence; /* changes with every new sample, to any value but 0; 0: not stated */
  double age;        /* s since the sample was taken, 0 when unknown */
} haptrace_plugin_sample_info;

/* Fills *sample, which is all zeros except for struct_size. */
void haptrace_plugin_sample(void* device, haptrace_plugin_sample_info* sample);

/* Optional: removes the force at once. haptrace calls it from another thread when an exchange has not returned for half
 * a second and still runs; the process ends soon after. Returns 0 if the motors are known to have no force, otherwise a
 * negative number. Without it haptrace asks the user to switch the device off. */
int haptrace_plugin_stop(void* device);

/* Sets zero force, releases the hardware and frees the memory. */
void haptrace_plugin_close(void* device);

#ifdef __cplusplus
}
#endif

#endif
