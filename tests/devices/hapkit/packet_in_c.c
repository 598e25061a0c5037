/* The sketch's header as C reads it, for hapkit_test.cpp to compare with C++. */
#include "devices/hapkit/hapkit_board.h"

unsigned hapkit_c_round_trip(unsigned char kind, unsigned sequence, long position, int duty, unsigned char* bytes);

/* Encodes a packet into `bytes`, and answers the size of what a board in C says to it, or 0. */
unsigned hapkit_c_round_trip(unsigned char kind, unsigned sequence, long position, int duty, unsigned char* bytes) {
  hapkit_packet packet = {0};
  hapkit_board board = {0};
  unsigned char answer[HAPKIT_PACKET_SIZE];
  packet.kind = kind;
  packet.version = HAPKIT_VERSION;
  packet.sequence = (uint16_t)sequence;
  packet.position = (int32_t)position;
  packet.duty = (int16_t)duty;
  hapkit_encode(&packet, bytes);
  for (unsigned i = 0; i < HAPKIT_PACKET_SIZE; ++i)
    if (hapkit_receive(&board, bytes[i], 0, 0, answer)) return HAPKIT_PACKET_SIZE;
  return 0;
}
