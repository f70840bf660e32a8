// The frame of docs/frame.md, version 1: one burst of an MPU-9250 over a serial line.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <string.h>

const uint8_t FRAME_VERSION = 1;
const size_t BURST_SIZE = 23;               // INT_STATUS to ST2 of the AK8963
const size_t FRAME_SIZE = 12 + BURST_SIZE + 2;
const size_t LINE_SIZE = FRAME_SIZE + 2;    // stuffed, and the zero that ends it

struct Sample {
  uint8_t whoAmI;
  uint8_t gyroRange;                        // 0: ±250 °/s, 1: ±500, 2: ±1000, 3: ±2000
  uint8_t accelRange;                       // 0: ±2 g, 1: ±4, 2: ±8, 3: ±16
  uint8_t adjustment[3];                    // the AK8963's fuses
  uint16_t sequence;
  uint32_t micros;
  uint8_t burst[BURST_SIZE];
};

// CRC-16/CCITT-FALSE.
inline uint16_t crc16(const uint8_t *data, size_t size) {
  uint16_t crc = 0xFFFF;
  while (size--) {
    crc ^= (uint16_t)*data++ << 8;
    for (int bit = 0; bit < 8; bit++)
      crc = crc & 0x8000 ? (uint16_t)(crc << 1) ^ 0x1021 : crc << 1;
  }
  return crc;
}

// COBS of less than 254 bytes, and a zero at the end: size + 2 bytes.
inline void stuff(const uint8_t *data, size_t size, uint8_t *out) {
  uint8_t *code = out++;
  *code = 1;
  while (size--) {
    if (*data) {
      *out++ = *data;
      ++*code;
    } else {
      code = out++;
      *code = 1;
    }
    data++;
  }
  *out = 0;
}

// The LINE_SIZE bytes that go over the line.
inline void packFrame(const Sample &sample, uint8_t *line) {
  uint8_t frame[FRAME_SIZE];
  frame[0] = FRAME_VERSION;
  frame[1] = sample.whoAmI;
  frame[2] = sample.gyroRange | sample.accelRange << 2;
  memcpy(frame + 3, sample.adjustment, 3);
  for (int n = 0; n < 2; n++)
    frame[6 + n] = (uint8_t)(sample.sequence >> 8 * n);
  for (int n = 0; n < 4; n++)
    frame[8 + n] = (uint8_t)(sample.micros >> 8 * n);
  memcpy(frame + 12, sample.burst, BURST_SIZE);
  uint16_t crc = crc16(frame, FRAME_SIZE - 2);
  frame[FRAME_SIZE - 2] = (uint8_t)crc;
  frame[FRAME_SIZE - 1] = (uint8_t)(crc >> 8);
  stuff(frame, FRAME_SIZE, line);
}
