// As much of Arduino as the bridge uses, on Linux: Serial is standard output, Wire is /dev/i2c-1.
#pragma once

#include <stdint.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define INPUT 0
#define RISING 3

inline uint64_t nanoseconds() {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1000000000ull + now.tv_nsec;
}
inline uint32_t micros() { return (uint32_t)(nanoseconds() / 1000); }
inline uint32_t millis() { return (uint32_t)(nanoseconds() / 1000000); }
inline void delay(uint32_t ms) { usleep(1000 * ms); }
inline void noInterrupts() {}
inline void interrupts() {}
inline void pinMode(int, int) {}
inline int digitalPinToInterrupt(int pin) { return pin; }
inline void attachInterrupt(int, void (*)(), int) {}

struct Port {
  void begin(uint32_t) {}
  size_t write(uint8_t byte) { return write(&byte, 1); }
  size_t write(const uint8_t *data, size_t size) {
    if (::write(STDOUT_FILENO, data, size) < 0)
      _exit(0);  // nobody listens any more
    return size;
  }
};
inline Port Serial;

void setup();
void loop();
int main() {
  setup();
  for (;;)
    loop();
}
