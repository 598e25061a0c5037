/* What a lab has before it has a plug-in: the functions that its own electronics came with. This board stands for them.
 * It drives a handle on a rail, with a motor, an encoder and an emergency stop; board and handle are simulated, in real
 * time. */
#ifndef SLIDER_BOARD_H
#define SLIDER_BOARD_H

#include <stdint.h>

typedef struct slider_board slider_board;

typedef enum slider_register {
  SLIDER_SERIAL,      /* read: its serial number */
  SLIDER_ENCODER,     /* read: 20 counts per millimetre, 0 in the middle of the rail */
  SLIDER_STATUS,      /* read: SLIDER_HOMED, SLIDER_STOPPED */
  SLIDER_MOTOR,       /* write: 200 counts per newton, -2047 to 2047, towards growing encoder counts */
  SLIDER_WATCHDOG_MS, /* write: after so long without a word for the motor it is switched off; 0: never */
  SLIDER_HOME         /* write 1: find the middle, which takes a moment; the encoder is not to be believed before */
} slider_register;

enum { SLIDER_HOMED = 1, SLIDER_STOPPED = 2 };

/* NULL when no board is at `port`, or somebody else has it. There is one at "sim0", and one at "loose", whose cable
 * slips out after a second. */
slider_board* slider_open(const char* port);

/* 0, or -1 when the board does not answer. They last some microseconds. */
int slider_read(slider_board* board, slider_register which, int32_t* value);
int slider_write(slider_board* board, slider_register which, int32_t value);

/* Says nothing to the motor. */
void slider_close(slider_board* board);

#endif
