// Sketch for Hapkit-class boards: an ATmega328 (Arduino Uno and kin), a magnetoresistive angle sensor, a motor on an
// H-bridge. It makes the board a device of haptrace; docs/devices/hapkit.md says how to build, flash and calibrate it.
// What it says on its line, and when its motor is off, stands in hapkit_board.h beside it.
#include <avr/wdt.h>

#include "hapkit_board.h"

const uint8_t kSensorPin = A2;
const uint8_t kPwmPin = 5;        // OC0B
const uint8_t kDirectionPin = 8;

hapkit_board board;
hapkit_sensor sensor;
int32_t position = 0;

void drive(int16_t duty) {
  const uint16_t size = duty < 0 ? -(int32_t)duty : duty;
  digitalWrite(kDirectionPin, duty < 0 ? LOW : HIGH);
  analogWrite(kPwmPin, size >> 7);  // 0 to 255
}

void setup() {
  MCUSR = 0;
  wdt_disable();
  pinMode(kPwmPin, OUTPUT);
  pinMode(kDirectionPin, OUTPUT);
  drive(0);
  // The pin's timer without a prescaler: 62.5 kHz, which nobody hears. It is also the timer of millis() and delay(),
  // which run 64 times as fast from now on; hence now_ms() below.
  TCCR0B = (TCCR0B & 0xF8) | 0x01;
  // A conversion in 26 us instead of 112, still to 10 bits within a count.
  ADCSRA = (ADCSRA & 0xF8) | 0x05;
  analogRead(kSensorPin);  // the first one is of the old setting
  Serial.begin(HAPKIT_BAUD);
  wdt_enable(WDTO_120MS);  // should this loop ever hang, the board starts anew, with its motor off
}

// Milliseconds. millis() would run over 64 times too early, and jump to 0 in the middle of this count.
uint32_t now_ms() {
  static uint32_t last = 0, rest = 0, ms = 0;
  const uint32_t fast = millis();
  rest += fast - last;
  last = fast;
  ms += rest >> 6;
  rest &= 63;
  return ms;
}

void loop() {
  wdt_reset();
  position = hapkit_position(&sensor, analogRead(kSensorPin));
  const uint32_t now = now_ms();
  uint8_t answer[HAPKIT_PACKET_SIZE];
  while (Serial.available() > 0)
    if (hapkit_receive(&board, Serial.read(), now, position, answer)) {
      drive(hapkit_duty(&board, now));
      Serial.write(answer, sizeof answer);
    }
  drive(hapkit_duty(&board, now));
}
