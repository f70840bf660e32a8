// Bridge: reads an MPU-9250 on I2C and sends each sample as a frame of docs/frame.md.
//
// For Arduino boards with Wire and a serial port of 921600 baud (Due, Zero, Teensy, RP2040), and
// for ESP32. What it needs to know of the board stands in the next lines.

#include <Wire.h>

#include "frame.h"

const uint32_t BAUD = 921600;
const uint32_t I2C_CLOCK = 400000;
const uint8_t ADDRESS = 0x68;       // 0x69 where AD0 is pulled up
const int INTERRUPT_PIN = -1;       // to the chip's INT: stamps to a microsecond; -1: not wired
const uint16_t RATE = 1000;         // Hz: 1000 divided by a whole number
const uint8_t LOW_PASS = 2;         // 1: 184 Hz, 2: 92, 3: 41, 4: 20, 5: 10, 6: 5
const uint8_t GYRO_RANGE = 2;       // 0: ±250 °/s, 1: ±500, 2: ±1000, 3: ±2000
const uint8_t ACCEL_RANGE = 1;      // 0: ±2 g, 1: ±4, 2: ±8, 3: ±16

// Registers, as in stateful_ahrs/mpu9250/registers.py
const uint8_t SMPLRT_DIV = 0x19, CONFIG = 0x1A, I2C_MST_CTRL = 0x24, I2C_SLV0_ADDR = 0x25,
              INT_PIN_CFG = 0x37, INT_ENABLE = 0x38, INT_STATUS = 0x3A, EXT_SENS_DATA = 0x49,
              I2C_SLV0_DO = 0x63, USER_CTRL = 0x6A, PWR_MGMT_1 = 0x6B, WHO_AM_I = 0x75;
const uint8_t AK8963 = 0x0C, AK_ST1 = 0x02, AK_CNTL1 = 0x0A, AK_CNTL2 = 0x0B, AK_ASAX = 0x10;

Sample sample;
uint32_t lastSample, lastCheck;
volatile uint32_t takenAt;
volatile uint16_t taken;

#ifndef IRAM_ATTR  // of the ESP32: where an interrupt's code must be
#define IRAM_ATTR
#endif
void IRAM_ATTR onInterrupt() {
  takenAt = micros();
  taken++;
}

bool writeRegisters(uint8_t first, const uint8_t *values, uint8_t count) {
  Wire.beginTransmission(ADDRESS);
  Wire.write(first);
  Wire.write(values, count);
  return Wire.endTransmission() == 0;
}

bool writeRegister(uint8_t address, uint8_t value) { return writeRegisters(address, &value, 1); }

bool readRegisters(uint8_t first, uint8_t *values, uint8_t count) {
  Wire.beginTransmission(ADDRESS);
  Wire.write(first);
  if (Wire.endTransmission(false) != 0 || Wire.requestFrom(ADDRESS, count) != count)
    return false;
  for (uint8_t n = 0; n < count; n++)
    values[n] = Wire.read();
  return true;
}

// One transfer of the chip's auxiliary master, which repeats it until it is stopped.
bool transfer(uint8_t address, uint8_t first, uint8_t count) {
  const uint8_t slave[] = {address, first, (uint8_t)(0x80 | count)};
  bool good = writeRegisters(I2C_SLV0_ADDR, slave, 3);
  delay(10);
  return good && writeRegister(I2C_SLV0_ADDR + 2, 0);
}

bool writeMagnetometer(uint8_t address, uint8_t value) {
  return writeRegister(I2C_SLV0_DO, value) && transfer(AK8963, address, 1);
}

bool startMagnetometer() {
  return writeRegister(I2C_MST_CTRL, 0x4D) &&            // 400 kHz, data ready waits for it
         writeRegister(USER_CTRL, 0x20) &&
         writeMagnetometer(AK_CNTL2, 0x01) &&            // reset
         writeMagnetometer(AK_CNTL1, 0x0F) &&            // fuse ROM
         transfer(AK8963 | 0x80, AK_ASAX, 3) &&
         readRegisters(EXT_SENS_DATA, sample.adjustment, 3) &&
         writeMagnetometer(AK_CNTL1, 0x00) &&
         writeMagnetometer(AK_CNTL1, 0x16) &&            // 16 bit, 100 Hz
         writeRegister(I2C_SLV0_ADDR, AK8963 | 0x80) &&  // with each sample: ST1 to ST2
         writeRegister(I2C_SLV0_ADDR + 1, AK_ST1) &&
         writeRegister(I2C_SLV0_ADDR + 2, 0x80 | 8);
}

bool start() {
  sample.whoAmI = 0xFF;
  sample.gyroRange = GYRO_RANGE;
  sample.accelRange = ACCEL_RANGE;
  memset(sample.adjustment, 0, 3);
  if (!writeRegister(PWR_MGMT_1, 0x80))
    return false;
  delay(110);
  if (!readRegisters(WHO_AM_I, &sample.whoAmI, 1) || !writeRegister(PWR_MGMT_1, 0x01))
    return false;
  delay(40);
  const uint8_t ranges[] = {LOW_PASS, (uint8_t)(GYRO_RANGE << 3), (uint8_t)(ACCEL_RANGE << 3),
                            LOW_PASS};
  const bool nineAxes = sample.whoAmI == 0x71 || sample.whoAmI == 0x73;
  return writeRegisters(CONFIG, ranges, 4) && (!nineAxes || startMagnetometer()) &&
         writeRegister(INT_PIN_CFG, 0x10) &&             // any read ends an interrupt
         writeRegister(INT_ENABLE, 0x01) &&
         writeRegister(SMPLRT_DIV, 1000 / RATE - 1);
}

// Whether the chip still has the ranges it was told: it forgets them when its supply drops.
bool configured() {
  uint8_t found[3];
  return readRegisters(CONFIG, found, 3) && found[0] == LOW_PASS && found[1] == GYRO_RANGE << 3 &&
         found[2] == ACCEL_RANGE << 3;
}

void send() {
  uint8_t line[LINE_SIZE];
  packFrame(sample, line);
  Serial.write(line, LINE_SIZE);
}

// Read a sample if there is a new one; false if the chip does not answer.
bool readSample() {
  if (INTERRUPT_PIN >= 0) {
    noInterrupts();
    const uint16_t number = taken;
    const uint32_t at = takenAt;
    interrupts();
    if (number == sample.sequence)
      return true;
    sample.sequence = number;
    sample.micros = at;
  } else {
    sample.micros = micros();
  }
  if (!readRegisters(INT_STATUS, sample.burst, BURST_SIZE))
    return false;
  if (!(sample.burst[0] & 0x01))
    return true;
  if (INTERRUPT_PIN < 0)
    sample.sequence++;
  lastSample = millis();
  send();
  return true;
}

// Say that nothing comes from the chip, and start it anew.
void recover() {
  memset(sample.burst, 0xFF, BURST_SIZE);
  sample.micros = micros();
  send();
  delay(100);
  start();
  lastSample = lastCheck = millis();
}

void setup() {
  Serial.begin(BAUD);
  Serial.write((uint8_t)0);  // ends whatever the start-up left on the line
  Wire.begin();
  Wire.setClock(I2C_CLOCK);
  if (INTERRUPT_PIN >= 0) {
    pinMode(INTERRUPT_PIN, INPUT);
    attachInterrupt(digitalPinToInterrupt(INTERRUPT_PIN), onInterrupt, RISING);
  }
  if (!start())
    recover();
  lastSample = lastCheck = millis();
}

void loop() {
  bool good = readSample() && millis() - lastSample < 300;
  if (good && millis() - lastCheck > 1000) {
    lastCheck = millis();
    good = configured();
  }
  if (!good)
    recover();
}
