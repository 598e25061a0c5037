/* Protocol between a Hapkit-class board and its host, and the board's behaviour. Plain C, without a library: the sketch
 * beside this file, haptrace's driver and its emulated board all compile this one file.
 *
 * In either direction, a packet has 14 bytes, with little-endian numbers:
 *
 *     0       0xA5
 *     1       kind: 1 hello, 2 welcome (its answer), 3 command, 4 state (its answer)
 *     2, 3    sequence number, which an answer repeats
 *     4 - 7   state, welcome: position [counts], signed
 *     8, 9    command: duty of the motor, -32767 to 32767, signed; state: the duty in effect
 *     10      welcome, state: flags
 *     11      version of this protocol
 *     12, 13  CRC-16/CCITT-FALSE of bytes 0 to 11
 *
 * A board answers every complete hello and command once and sends nothing else. Its motor is off from the start until
 * the host has greeted it, and whenever no complete command has come for HAPKIT_WATCHDOG_MS. */
#ifndef HAPKIT_BOARD_H
#define HAPKIT_BOARD_H

#include <stdint.h>

/* The names of C programs. NOLINTBEGIN(readability-identifier-naming) */

#define HAPKIT_VERSION 1
#define HAPKIT_BAUD 500000 /* exact on an ATmega with 16 MHz; 14 bytes take 0.28 ms */
#define HAPKIT_WATCHDOG_MS 50
#define HAPKIT_FULL_DUTY 32767
#define HAPKIT_PACKET_SIZE 14
#define HAPKIT_SYNC 0xA5

enum hapkit_kind { HAPKIT_HELLO = 1, HAPKIT_WELCOME = 2, HAPKIT_COMMAND = 3, HAPKIT_STATE = 4 };

enum hapkit_flag {
  HAPKIT_GREETED = 1, /* greeted since the start; if not, the board restarted and counts from elsewhere */
  HAPKIT_TRIPPED = 2  /* the watchdog had switched the motor off before this command */
};

typedef struct hapkit_packet {
  uint8_t kind, flags, version;
  uint16_t sequence;
  int32_t position; /* [counts] */
  int16_t duty;     /* relative to HAPKIT_FULL_DUTY */
} hapkit_packet;

/* Computes the CRC with polynomial 0x1021 and initial value 0xFFFF, neither reflected nor inverted: 0x29B1 for
 * "123456789". */
static inline uint16_t hapkit_crc(const uint8_t* bytes, uint8_t count) {
  uint16_t crc = 0xFFFF;
  for (uint8_t i = 0; i < count; ++i) {
    crc = (uint16_t)(crc ^ ((uint16_t)bytes[i] << 8));
    for (uint8_t bit = 0; bit < 8; ++bit)
      crc = (uint16_t)((crc & 0x8000) != 0 ? ((uint32_t)crc << 1) ^ 0x1021 : (uint32_t)crc << 1);
  }
  return crc;
}

static inline void hapkit_encode(const hapkit_packet* packet, uint8_t bytes[HAPKIT_PACKET_SIZE]) {
  const uint32_t position = (uint32_t)packet->position;
  const uint16_t duty = (uint16_t)packet->duty;
  bytes[0] = HAPKIT_SYNC;
  bytes[1] = packet->kind;
  bytes[2] = (uint8_t)(packet->sequence & 0xFF);
  bytes[3] = (uint8_t)(packet->sequence >> 8);
  for (uint8_t i = 0; i < 4; ++i) bytes[4 + i] = (uint8_t)(position >> (8 * i) & 0xFF);
  bytes[8] = (uint8_t)(duty & 0xFF);
  bytes[9] = (uint8_t)(duty >> 8);
  bytes[10] = packet->flags;
  bytes[11] = packet->version;
  const uint16_t crc = hapkit_crc(bytes, HAPKIT_PACKET_SIZE - 2);
  bytes[12] = (uint8_t)(crc & 0xFF);
  bytes[13] = (uint8_t)(crc >> 8);
}

/* Finds packets in a stream by the last bytes alone, so that no earlier byte can hide a packet. Starts as all zeros. */
typedef struct hapkit_decoder {
  uint8_t bytes[HAPKIT_PACKET_SIZE]; /* the oldest first */
} hapkit_decoder;

/* Takes a byte. Returns 1 if a packet ends with it, and fills *packet. */
static inline uint8_t hapkit_decode(hapkit_decoder* decoder, uint8_t byte, hapkit_packet* packet) {
  uint8_t* const b = decoder->bytes;
  for (uint8_t i = 0; i + 1 < HAPKIT_PACKET_SIZE; ++i) b[i] = b[i + 1];
  b[HAPKIT_PACKET_SIZE - 1] = byte;
  if (b[0] != HAPKIT_SYNC || b[1] < HAPKIT_HELLO || b[1] > HAPKIT_STATE) return 0;
  const uint16_t crc = hapkit_crc(b, HAPKIT_PACKET_SIZE - 2);
  if (b[12] != (crc & 0xFF) || b[13] != crc >> 8) return 0;
  packet->kind = b[1];
  packet->sequence = (uint16_t)(b[2] | (uint16_t)b[3] << 8);
  packet->position = (int32_t)((uint32_t)b[4] | (uint32_t)b[5] << 8 | (uint32_t)b[6] << 16 | (uint32_t)b[7] << 24);
  packet->duty = (int16_t)(uint16_t)(b[8] | (uint16_t)b[9] << 8);
  packet->flags = b[10];
  packet->version = b[11];
  return 1;
}

/* State of a board between its line and its motor. Starts as all zeros. */
typedef struct hapkit_board {
  hapkit_decoder decoder;
  uint8_t greeted, tripped;
  int16_t duty;             /* last command */
  uint32_t commanded_at_ms; /* time of the last command */
} hapkit_board;

/* Returns the motor's duty at `now_ms`, a time that may overflow. Call it in every pass of the board's loop. */
static inline int16_t hapkit_duty(hapkit_board* board, uint32_t now_ms) {
  if (board->duty != 0 && now_ms - board->commanded_at_ms >= HAPKIT_WATCHDOG_MS) {
    board->duty = 0;
    board->tripped = 1;
  }
  return board->duty;
}

/* Takes a byte from the host. If it ends a packet for the board, fills `answer` and returns 1. */
static inline uint8_t hapkit_receive(hapkit_board* board, uint8_t byte, uint32_t now_ms, int32_t position,
                                     uint8_t answer[HAPKIT_PACKET_SIZE]) {
  hapkit_packet packet;
  if (!hapkit_decode(&board->decoder, byte, &packet)) return 0;
  if (packet.kind != HAPKIT_HELLO && packet.kind != HAPKIT_COMMAND) return 0;
  hapkit_packet reply;
  if (packet.kind == HAPKIT_HELLO) {
    board->greeted = packet.version == HAPKIT_VERSION;
    board->duty = 0;
    board->tripped = 0;
  } else {
    (void)hapkit_duty(board, now_ms);
    board->duty = board->greeted && packet.version == HAPKIT_VERSION ? packet.duty : (int16_t)0;
    board->commanded_at_ms = now_ms;
  }
  reply.kind = packet.kind == HAPKIT_HELLO ? HAPKIT_WELCOME : HAPKIT_STATE;
  reply.version = HAPKIT_VERSION;
  reply.sequence = packet.sequence;
  reply.position = position;
  reply.duty = board->duty;
  reply.flags = (uint8_t)((board->greeted ? HAPKIT_GREETED : 0) | (board->tripped ? HAPKIT_TRIPPED : 0));
  if (packet.kind == HAPKIT_COMMAND) board->tripped = 0;
  hapkit_encode(&reply, answer);
  return 1;
}

/* A magnetoresistive sensor over a rotating magnet: its reading is periodic. */
#define HAPKIT_SENSOR_PERIOD 980 /* counts between two positions with the same reading; see the manual */
#define HAPKIT_SENSOR_MIDDLE 512

typedef struct hapkit_sensor {
  int16_t last;
  int32_t periods;
  uint8_t begun;
} hapkit_sensor;

/* Returns the position [counts] for a reading: 0 where the sensor reads HAPKIT_SENSOR_MIDDLE in the period in which the
 * board started. Correct if the handle moves less than half a period between two readings. */
static inline int32_t hapkit_position(hapkit_sensor* sensor, int16_t reading) {
  if (!sensor->begun) sensor->last = reading;
  sensor->begun = 1;
  const int16_t step = (int16_t)(reading - sensor->last);
  if (step > HAPKIT_SENSOR_PERIOD / 2) --sensor->periods;
  if (step < -HAPKIT_SENSOR_PERIOD / 2) ++sensor->periods;
  sensor->last = reading;
  return sensor->periods * HAPKIT_SENSOR_PERIOD + (reading - HAPKIT_SENSOR_MIDDLE);
}

/* NOLINTEND(readability-identifier-naming) */

#endif
