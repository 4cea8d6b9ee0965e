// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace shiftmap {

/// Processor time of the calling thread: what it used, however busy the machine is. [s]
double ThreadProcessorSeconds();

/// Processor time of all threads of the process. [s]
double ProcessorSeconds();

}  // namespace shiftmap
