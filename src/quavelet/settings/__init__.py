"""All that can be set, from three places: the defaults in `tables`, a TOML file, the command line."""

from quavelet.attitude.params import FilterParams
from quavelet.mpu6050.offset_settings import OffsetSettings
from quavelet.settings.checking import parse_settings
from quavelet.settings.hot import HOT_TABLES, is_hot
from quavelet.settings.loading import LoadedSettings, Table, Tables, Value, as_tables, load_settings
from quavelet.settings.outputs import Destination, EncodingName, MqttSettings, OutputSettings
from quavelet.settings.service import RecordingSettings, ServiceSettings
from quavelet.settings.tables import (
    BusSettings,
    CalibrationSettings,
    LoopSettings,
    MountingSettings,
    Settings,
    StartSettings,
)
from quavelet.settings.web import WebSettings

__all__ = [
    "HOT_TABLES",
    "BusSettings",
    "CalibrationSettings",
    "Destination",
    "EncodingName",
    "FilterParams",
    "LoadedSettings",
    "LoopSettings",
    "MountingSettings",
    "MqttSettings",
    "OffsetSettings",
    "OutputSettings",
    "RecordingSettings",
    "ServiceSettings",
    "Settings",
    "StartSettings",
    "Table",
    "Tables",
    "Value",
    "WebSettings",
    "as_tables",
    "is_hot",
    "load_settings",
    "parse_settings",
]
