// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/run_report.h"

namespace shiftmap {

void ReportRun(const std::string& output, const Run& run, const Json& more, Context& context) {
  std::size_t observations = 0;
  for (const Scan& scan : run.scans) observations += scan.observations.size();
  const double duration_s = ToSeconds(run.odometry.back().stamp - run.odometry.front().stamp);
  Json document = {{"output", output},
                   {"source", run.info.source},
                   {"begin_s", ToSecondsSinceEpoch(run.odometry.front().stamp)},
                   {"duration_s", duration_s},
                   {"odometry", run.odometry.size()},
                   {"scans", run.scans.size()},
                   {"observations", observations}};
  document.update(more);
  context.Report(document,
                 fmt::format("{}: {:.1f} s, {} odometry samples, {} scans with {} observations\n",
                             output,
                             duration_s,
                             run.odometry.size(),
                             run.scans.size(),
                             observations));
}

}  // namespace shiftmap
