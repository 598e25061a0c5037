#define _POSIX_C_SOURCE 200809L

#include "slider_board.h"

#include <math.h>
#include <string.h>
#include <time.h>

struct slider_board {
  int in_use, loose;
  double opened, now;          /* s, of the monotonic clock */
  double homed_at;             /* s */
  double motor, motor_written; /* N, s */
  double watchdog;             /* s; 0: none */
  double position, velocity;   /* m, m/s */
};

static slider_board board; /* There is one. */

static double clock_now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* A mass of 0.3 kg with 1.5 N s/m and 0.1 N of friction, between stops. */
static void advance(slider_board* b) {
  const double mass = 0.3, viscous = 1.5, coulomb = 0.1, stop = 0.11, longest = 1e-4, end = clock_now();
  if (end - b->now > 0.5) b->now = end - 0.5;
  while (b->now < end) {
    const double dt = fmin(longest, end - b->now);
    if (b->watchdog > 0 && b->now - b->motor_written > b->watchdog) b->motor = 0;
    b->velocity += dt * (b->motor - viscous * b->velocity) / mass;
    b->velocity -= copysign(fmin(fabs(b->velocity), dt * coulomb / mass), b->velocity);
    b->position += dt * b->velocity;
    if (fabs(b->position) > stop) {
      b->position = copysign(stop, b->position);
      b->velocity = 0;
    }
    b->now += dt;
  }
}

slider_board* slider_open(const char* port) {
  const int loose = strcmp(port, "loose") == 0;
  if (board.in_use || (!loose && strcmp(port, "sim0") != 0)) return NULL;
  memset(&board, 0, sizeof board);
  board.in_use = 1;
  board.loose = loose;
  board.opened = board.now = clock_now();
  board.homed_at = INFINITY;
  return &board;
}

static int answers(slider_board* b) {
  if (b->loose && clock_now() - b->opened > 1) return 0;
  advance(b);
  return 1;
}

int slider_read(slider_board* b, slider_register which, int32_t* value) {
  if (!answers(b)) return -1;
  const int homed = b->now >= b->homed_at;
  if (which == SLIDER_SERIAL) *value = 1017;
  if (which == SLIDER_ENCODER) *value = homed ? (int32_t)floor(20e3 * b->position + 0.5) : 0;
  if (which == SLIDER_STATUS) *value = homed ? SLIDER_HOMED : 0;
  return 0;
}

int slider_write(slider_board* b, slider_register which, int32_t value) {
  if (!answers(b)) return -1;
  if (which == SLIDER_MOTOR) {
    b->motor = fmin(2047, fmax(-2047, value)) / 200;
    b->motor_written = b->now;
  }
  if (which == SLIDER_WATCHDOG_MS) b->watchdog = 1e-3 * value;
  if (which == SLIDER_HOME) b->homed_at = b->now + 0.2;
  return 0;
}

void slider_close(slider_board* b) {
  b->in_use = 0;
}
