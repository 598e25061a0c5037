/* The plug-in ABI: a lab's own device in one C file, loaded with
 *
 *     haptrace record out.h5 --device plugin:path=./libmine.so,options={"port":"/dev/ttyACM0"}
 *
 * C and C++. SI units; positions are p_WT and forces are on the hand, both in the device's base frame W.
 * haptrace calls one function at a time. `exchange` is called from the servo loop: it must return well within a tick
 * and must not block; a device with slow I/O owns a thread and exchanges the newest values with it.
 * docs/plugins.md makes one step by step. */
#ifndef HAPTRACE_DEVICES_PLUGIN_H
#define HAPTRACE_DEVICES_PLUGIN_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HAPTRACE_PLUGIN_ABI 1

typedef struct haptrace_plugin_info {
  uint32_t struct_size; /* set by the caller: sizeof of its own declaration */
  uint32_t flags;       /* bit 0: virtual time, the device advances only by exchange's dt */
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

/* Before every exchange it is: not ready, nothing but zeros, NaN where that says "not measured". */
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

/* Opens the device, fills *device and *info. Returns 0, or a negative number with the reason in `error`. */
int haptrace_plugin_open(const char* options_json, void** device, haptrace_plugin_info* info, char* error,
                         size_t error_size);

/* Applies `wrench` (N, N m) from now on, lets a virtual-time device advance by dt seconds under it, and returns the
 * newest state. The first exchange of a session has dt = 0. Returns 0, or a negative number when the device is lost. */
int haptrace_plugin_exchange(void* device, double dt, const double wrench[6], haptrace_plugin_state* state);

/* Optional: which sample the state of the last exchange is. A plug-in that exports haptrace_plugin_sample is asked
 * right after every exchange that returned 0, from the same thread, under the same rules. haptrace then knows a new
 * sample from a repeated one: a repeated state is not recorded and not controlled, velocities use the samples' own
 * times, and force fades to zero when no new sample comes for 20 ms (three ticks where they are longer). Without it
 * every exchange counts as a new sample, taken at that moment. */
typedef struct haptrace_plugin_sample_info {
  uint32_t struct_size; /* set by the caller: sizeof of its own declaration */
  uint32_t reserved;
  uint64_t sequence; /* changes with every new sample, never 0; 0: not stated */
  double age;        /* s since the sample was taken, 0 when not known */
} haptrace_plugin_sample_info;

/* Fills *sample, which is all zeros but for struct_size. */
void haptrace_plugin_sample(void* device, haptrace_plugin_sample_info* sample);

/* Optional: takes the force away at once. Called when an exchange has not returned for half a second, from another
 * thread, while that exchange still runs; the process ends soon after. Returns 0 when the motors are known to have no
 * force, else a negative number. Without it the user is told to switch the device off. */
int haptrace_plugin_stop(void* device);

/* Zero force, hardware released, memory freed. */
void haptrace_plugin_close(void* device);

#ifdef __cplusplus
}
#endif

#endif
