/* An example of a vendor's interface, which a plug-in connects to haptrace. The board drives a handle on a rail, with a
 * motor, an encoder and an emergency stop. Board and handle are simulated in real time. */
#ifndef SLIDER_BOARD_H
#define SLIDER_BOARD_H

#include <stdint.h>

typedef struct slider_board slider_board;

typedef enum slider_register {
  SLIDER_SERIAL,      /* read: serial number */
  SLIDER_ENCODER,     /* read: 20 counts per millimetre, 0 in the middle of the rail */
  SLIDER_STATUS,      /* read: SLIDER_HOMED, SLIDER_STOPPED */
  SLIDER_MOTOR,       /* write: 200 counts per newton, -2047 to 2047, towards growing encoder counts */
  SLIDER_WATCHDOG_MS, /* write: the motor goes off after this long without a SLIDER_MOTOR write; 0: never */
  SLIDER_HOME         /* write 1: find the middle, which takes 0.2 s; the encoder is not valid before */
} slider_register;

enum { SLIDER_HOMED = 1, SLIDER_STOPPED = 2 };

/* Opens the board at `port`; returns NULL if there is none or it is already open. The board answers at "sim0", and at
 * "loose", where its cable slips out after 1 s. */
slider_board* slider_open(const char* port);

/* Both return 0, or -1 if the board does not answer. A call takes a few microseconds. */
int slider_read(slider_board* board, slider_register which, int32_t* value);
int slider_write(slider_board* board, slider_register which, int32_t value);

/* Closes the board; sends nothing to the motor. */
void slider_close(slider_board* board);

#endif
