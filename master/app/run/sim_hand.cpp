#include "telenano/master/app/run/sim_hand.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "telenano/common/base/error.h"
#include "telenano/master/app/plan/station_plan.h"

namespace telenano::app {

device::IntendedMotion intended_motion(const RunOptions& options, device::TaskOptions task_options,
                                       double start_height_nm) {
  const device::Task task = device::parse_task(options.task);
  if (task == device::Task::kScript) {
    if (options.script.empty())
      throw UserError("--task script needs --script FILE (CSV: t_s,x_nm,y_nm,z_nm)");
    return device::IntendedMotion::from_csv_file(options.script);
  }
  task_options.start_height_nm = start_height_nm;
  task_options.retract_nm = std::max(task_options.retract_nm, start_height_nm);
  return device::IntendedMotion::for_task(task, task_options);
}

device::IntendedMotion hand_motion(const RunOptions& options, const device::TaskOptions& task_options,
                                   double start_height_nm, bool only_looks_on) {
  device::IntendedMotion motion = intended_motion(options, task_options, start_height_nm);
  if (!only_looks_on) return motion;
  const Vec3 start_nm(0, 0, start_height_nm);
  return device::IntendedMotion({{0, start_nm}, {motion.duration_s(), start_nm}});
}

std::vector<SimTask> add_tasks(device::SimDevice& hand, const RunOptions& options,
                               device::TaskOptions task_options, double start_height_nm,
                               const rt::LatestValue<device::PointerState>* pointer) {
  task_options.start_height_nm = start_height_nm;
  task_options.retract_nm = std::max(task_options.retract_nm, start_height_nm);
  const std::array<std::pair<device::Task, const char*>, 4> known = {
      {{device::Task::kPosition, "hold above the surface"},
       {device::Task::kContact, "just in contact"},
       {device::Task::kIndent, "press, pull off"},
       {device::Task::kScan, "lines in light contact"}}};
  std::vector<SimTask> tasks;
  const auto tell = [&](const std::string& name, const char* about, int number, bool free = false) {
    tasks.push_back({name, about, hand.reach_nm(number), free});
  };
  const auto first = std::find_if(known.begin(), known.end(), [&](const auto& task) {
    return device::task_name(task.first) == options.task;
  });
  tell(options.task, first == known.end() ? "the path of the file" : first->second, 0);
  for (const auto& [task, about] : known) {
    if (first != known.end() && task == first->first) continue;
    tell(std::string(device::task_name(task)), about,
         hand.add_task(device::IntendedMotion::for_task(task, task_options)));
  }
  if (pointer != nullptr) tell("free hand", "your mouse leads it", hand.add_free_task(*pointer), true);
  return tasks;
}

std::vector<control::CompandingConfig> companding_of_tasks(const StationFile& file,
                                                           const std::vector<SimTask>& tasks) {
  std::vector<control::CompandingConfig> all;
  for (const SimTask& task : tasks) all.push_back(companding_of(file, task.free ? "hand" : task.name));
  return all;
}

device::SimDeviceConfig sim_device_config(const StationFile& file, double start_height_nm) {
  device::SimDeviceConfig config;
  config.plant = file.plant;
  config.metres_per_nm = file.station.scaling.hand_displacement_m(Vec3::UnitX()).x();
  config.start_height_nm = start_height_nm;
  return config;
}

}  // namespace telenano::app
