// The ring that carries scans from the USB thread to a reader: a short one for the mapper, a long one for the recorder.
//
// Its contract is SpscRing's. A slot is 4.4 kB: at 40 scans a second 160 slots are four seconds and 0.7 MB.
#pragma once

#include "driver/device_scan.hpp"
#include "driver/ring/spsc_ring.hpp"

namespace submapd::driver {

using ScanRing = SpscRing<DeviceScan>;

}  // namespace submapd::driver
