"""Hydra's launcher for Ray: `hydra/launcher=ray`, tasks on all nodes of a cluster.

    ray start --head                                    on one machine; prints what the others are to be started with
    runner -m ... hydra/launcher=ray hydra.launcher.address=auto

All nodes need the same installation and the folder of the results. Hydra's own plug-in for Ray can't be installed
beside joblib 1.6 (it wants cloudpickle below 3), and fails on a cluster that runs already.
"""

# annotations are not postponed: Hydra imports plug-ins in a way in which dataclasses can't look them up

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, run_job, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, open_dict

from runner.errors import ConfigError


@dataclass
class RayLauncherConfig:
    """Settings below `hydra.launcher`.

    `address` null: what the variable RAY_ADDRESS says, or a cluster of this machine alone; "auto": the one that runs
    here. `cores_per_task` decides how many tasks a node takes at once. A task whose node is lost is done again
    `retries` times.
    """

    _target_: str = "hydra_plugins.runner_ray_launcher.RayLauncher"
    address: str | None = None
    cores_per_task: float = 1.0
    retries: int = 3


class RayLauncher(Launcher):
    """Does each job as a task of Ray."""

    def __init__(self, address: str | None, cores_per_task: float, retries: int) -> None:
        self.address, self.cores_per_task, self.retries = address, cores_per_task, retries

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """Do the jobs, and return what became of them in their order."""
        try:
            import ray
        except ModuleNotFoundError:
            raise ConfigError(
                "hydra/launcher: Ray is not installed; it comes with the extra: pip install 'runner[cluster]'."
            ) from None

        setup_globals()
        connected = ray.is_initialized()
        if not connected:
            ray.init(address=self.address, log_to_driver=False, logging_level=logging.ERROR)
        try:
            task = ray.remote(num_cpus=self.cores_per_task, max_retries=self.retries)(_do)
            shared = ray.put((self.hydra_context, self.task_function, Singleton.get_state()))
            tasks = [
                task.remote(shared, self._config(list(overrides), initial_job_idx + i))
                for i, overrides in enumerate(job_overrides)
            ]
            return ray.get(tasks)
        finally:
            if not connected:
                ray.shutdown()

    def _config(self, overrides: list[str], number: int) -> DictConfig:
        config = self.hydra_context.config_loader.load_sweep_config(self.config, overrides)
        with open_dict(config):
            config.hydra.job.id = f"ray_{number}"
            config.hydra.job.num = number
        return config


def _do(shared: tuple[HydraContext, TaskFunction, Any], config: DictConfig) -> JobReturn:
    """Do one job, in a process of Ray's."""
    context, function, state = shared
    setup_globals()
    Singleton.set_state(state)
    HydraConfig.instance().set_config(config)
    return run_job(
        hydra_context=context,
        task_function=function,
        config=config,
        job_dir_key="hydra.sweep.dir",
        job_subdir_key="hydra.sweep.subdir",
    )


ConfigStore.instance().store(group="hydra/launcher", name="ray", node=RayLauncherConfig, provider="runner")
