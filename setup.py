"""The package for pip and for colcon; package.xml has the same for rosdep."""

from glob import glob

from setuptools import find_packages, setup

setup(
    name="stateful_ahrs",
    version="0.1.0",
    description="Orientation from a nine-axis sensor: one rotor that never flips sign",
    license="Apache-2.0",
    maintainer="The stateful_ahrs maintainers",
    maintainer_email="maintainers@stateful-ahrs.dev",
    packages=find_packages(include=["stateful_ahrs", "stateful_ahrs.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/stateful_ahrs"]),
        ("share/stateful_ahrs", ["package.xml"]),
        ("share/stateful_ahrs/launch", sorted(glob("launch/*.launch.py"))),
        ("share/stateful_ahrs/config", sorted(glob("config/*"))),
    ],
    entry_points={
        "console_scripts": [
            "imu_driver = stateful_ahrs.nodes.imu_driver:main",
            "fusion = stateful_ahrs.nodes.fusion:main",
            "bag_player = stateful_ahrs.nodes.bag_player:main",
            "calibrate = stateful_ahrs.nodes.calibrate:main",
            "evaluate = stateful_ahrs.evaluation.evaluate:main",
            "convert = stateful_ahrs.recordings.convert:main",
        ]
    },
    python_requires=">=3.10",
    install_requires=["numpy>=1.26", "rich>=13"],
    extras_require={
        # ROS 2 Jazzy from PyPI (Linux on x86-64), where Jazzy itself is not installed.
        "jazzy": [
            "ros-jazzy-builtin-interfaces",
            "ros-jazzy-diagnostic-msgs",
            "ros-jazzy-geometry-msgs",
            "ros-jazzy-rcl-interfaces",
            "ros-jazzy-rclpy",
            "ros-jazzy-rmw-fastrtps-cpp",
            "ros-jazzy-rosgraph-msgs",
            "ros-jazzy-sensor-msgs",
            "ros-jazzy-std-msgs",
            "ros-jazzy-std-srvs",
        ],
        "bags": ["rosbags>=0.11", "scipy>=1.11"],
        "fast": ["numba>=0.59", "scipy>=1.11"],  # numba's linear algebra is scipy's
        "plot": ["matplotlib>=3.6"],
        "parallel": ["joblib>=1.3"],
        "cluster": ["distributed>=2023.12", "joblib>=1.3"],
        "i2c": ["smbus2>=0.4"],
        "serial": ["pyserial>=3.5"],
        "calibration": ["PyYAML>=6.0", "scipy>=1.11"],
        "bench": ["ahrs>=0.3.1", "imufusion>=1.3", "vqf>=2.1"],  # to compare with
        "test": ["hypothesis>=6.98", "pytest>=7.4"],
        "lint": ["mypy>=1.13", "ruff>=0.17"],
    },
    zip_safe=False,
)
