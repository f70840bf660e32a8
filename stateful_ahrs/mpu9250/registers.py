"""Registers of the MPU-9250 and of the AK8963 in the same case, as far as they are used here.

Sources: InvenSense RM-MPU-9250A-00 1.6 (register map), Asahi Kasei AK8963 data sheet MS1356-E-02.
"""

from __future__ import annotations

# --- MPU-9250 ------------------------------------------------------------------------------------

ADDRESS = 0x68  # 0x69 where the board pulls AD0 up

SELF_TEST_GYRO = 0x00  # x, then y, z: codes of what the self-test moved in the factory
SELF_TEST_ACCEL = 0x0D
SMPLRT_DIV = 0x19
CONFIG = 0x1A
DLPF_MASK = 0x07
GYRO_CONFIG = 0x1B
ACCEL_CONFIG = 0x1C
RANGE_SHIFT = 3  # of both: 0 to 3, each twice the range of the one before
SELF_TEST_XYZ = 0xE0  # of both
ACCEL_CONFIG2 = 0x1D

FIFO_EN = 0x23
FIFO_INERTIAL = 0xF8  # temperature, gyroscope x, y, z, accelerometer
FIFO_SLV0 = 0x01
I2C_MST_CTRL = 0x24
WAIT_FOR_ES = 0x40  # data ready only when the external sensor's bytes are there too
I2C_MST_400_KHZ = 0x0D
I2C_SLV0_ADDR = 0x25
I2C_READ = 0x80
I2C_SLV0_REG = 0x26
I2C_SLV0_CTRL = 0x27
I2C_SLV0_EN = 0x80
I2C_SLV0_LENGTH_MASK = 0x0F
I2C_MST_STATUS = 0x36
I2C_SLV0_NACK = 0x01

INT_PIN_CFG = 0x37
BYPASS_EN = 0x02
INT_ENABLE = 0x38
INT_STATUS = 0x3A
RAW_DATA_RDY = 0x01  # of both
FIFO_OFLOW = 0x10  # of both

ACCEL_XOUT_H = 0x3B  # then y, z, temperature, gyroscope x, y, z: 14 bytes, high byte first
EXT_SENS_DATA_00 = 0x49
I2C_SLV0_DO = 0x63

USER_CTRL = 0x6A
USE_FIFO = 0x40
I2C_MST_EN = 0x20
FIFO_RST = 0x04
PWR_MGMT_1 = 0x6B
H_RESET = 0x80
SLEEP = 0x40
CLKSEL_AUTO = 0x01  # the gyroscope's PLL where it runs
FIFO_COUNTH = 0x72  # reading it holds FIFO_COUNTL
FIFO_COUNT_MASK = 0x1FFF
FIFO_R_W = 0x74  # a burst from here takes bytes out of the FIFO
FIFO_SIZE = 512
WHO_AM_I = 0x75
MPU_9250 = 0x71  # what it answers there

# --- AK8963 --------------------------------------------------------------------------------------

AK_ADDRESS = 0x0C

AK_WIA = 0x00
AK_DEVICE_ID = 0x48
AK_ST1 = 0x02
AK_DRDY = 0x01
AK_DOR = 0x02
AK_HXL = 0x03  # then y, z: 6 bytes, low byte first
AK_ST2 = 0x09  # reading it releases the next measurement
AK_HOFL = 0x08
AK_CNTL1 = 0x0A
AK_MODE_MASK = 0x0F
AK_POWER_DOWN = 0x00
AK_CONTINUOUS_8_HZ = 0x02
AK_CONTINUOUS_100_HZ = 0x06
AK_FUSE_ROM = 0x0F
AK_16_BIT = 0x10
AK_CNTL2 = 0x0B
AK_SOFT_RESET = 0x01
AK_ASAX = 0x10  # then y, z; readable in the mode AK_FUSE_ROM alone
