// Arduino's Wire on Linux's /dev/i2c-1.
#pragma once

#include <fcntl.h>
#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <stdint.h>
#include <sys/ioctl.h>

class TwoWire {
 public:
  void begin() { file = open("/dev/i2c-1", O_RDWR); }
  void setClock(uint32_t) {}
  void beginTransmission(uint8_t to) {
    address = to;
    length = 0;
  }
  size_t write(uint8_t byte) {
    out[length++] = byte;
    return 1;
  }
  size_t write(const uint8_t *data, size_t size) {
    for (size_t n = 0; n < size; n++)
      write(data[n]);
    return size;
  }
  // What is to be followed by a read is kept for it: one transaction.
  uint8_t endTransmission(bool stop = true) {
    i2c_msg message = {address, 0, length, out};
    return stop ? transfer(&message, 1) : 0;
  }
  uint8_t requestFrom(uint8_t from, uint8_t count) {
    i2c_msg messages[] = {{from, 0, length, out}, {from, I2C_M_RD, count, in}};
    position = 0;
    return transfer(messages, 2) ? 0 : count;
  }
  int read() { return in[position++]; }

 private:
  int file = -1;
  uint8_t address = 0, position = 0, out[32], in[32];
  uint16_t length = 0;

  uint8_t transfer(i2c_msg *messages, uint32_t count) {
    i2c_rdwr_ioctl_data data = {messages, count};
    return ioctl(file, I2C_RDWR, &data) < 0 ? 2 : 0;
  }
};
inline TwoWire Wire;
