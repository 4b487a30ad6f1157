"""A Slurm of one node, run by the present user in a folder of its own: munged, slurmctld, slurmd."""

import contextlib
import getpass
import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "scontrol", "squeue")
SEARCHED = os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/sbin"])  # daemons are not on a user's path

CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
SlurmctldPort={controller}
SlurmdPort={daemon}
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SwitchType=switch/none
MpiDefault=none
MailProg=/bin/true
JobRequeue=1
ReturnToService=2
SlurmdTimeout=5
KillWait=2
SlurmdParameters=config_overrides
NodeName={host} NodeAddr=127.0.0.1 CPUs=2
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE
"""


def missing():
    """Programs of Slurm's that are not installed here."""
    return [name for name in PROGRAMS if not shutil.which(name, path=SEARCHED)]


def wait_until(what, condition, seconds=120):
    end = time.time() + seconds
    while not (found := condition()):
        assert time.time() < end, f"{what}: not within {seconds} s"
        time.sleep(0.2)
    return found


class OneNode:
    """Starts with ``with``; ends everything that it and its jobs started."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.environment = {
            **os.environ, "PATH": SEARCHED, "SLURM_CONF": str(self.folder / "slurm.conf"),
        }  # fmt: skip
        self._running = {}

    def __enter__(self):
        for name in ("state", "spool"):
            (self.folder / name).mkdir(parents=True)
        self.folder.chmod(0o755)  # munged refuses a folder that others may write to
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        controller, daemon = _free_ports()
        (self.folder / "slurm.conf").write_text(
            CONFIGURATION.format(
                host=socket.gethostname().split(".")[0],
                user=getpass.getuser(),
                folder=self.folder,
                controller=controller,
                daemon=daemon,
            )
        )
        try:
            self._start(
                "munged", "--foreground", "--force", f"--key-file={key}",
                f"--socket={self.folder}/munge.socket",
                f"--pid-file={self.folder}/munged.pid", f"--log-file={self.folder}/munged.log",
                f"--seed-file={self.folder}/munged.seed",
            )  # fmt: skip
            wait_until("munged", (self.folder / "munge.socket").exists)
            self._start("slurmctld", "-D", "-i")
            self.start_node()
            wait_until("a node that is idle", lambda: self.ask("sinfo", "--noheader", "-o", "%T") == "idle")
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *error):
        self._end()

    def _start(self, program, *arguments):
        with (self.folder / f"{program}.out").open("ab") as output:
            self._running[program] = subprocess.Popen(
                [program, *arguments], env=self.environment, stdout=output, stderr=output,
                start_new_session=True,
            )  # fmt: skip

    def _end(self):
        with contextlib.suppress(subprocess.SubprocessError):
            subprocess.run(["scancel", "--full", "-u", getpass.getuser()], env=self.environment, timeout=10)
            wait_until("an empty queue", lambda: not self.jobs(), 15)
        self.kill_node()
        for process in reversed(self._running.values()):
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
            process.kill()

    def start_node(self):
        self._start("slurmd", "-D")

    def kill_node(self):
        """As a loss of power would: the daemon, the steps' and the jobs' processes at once."""
        for process in self._of_node():
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        if "slurmd" in self._running:
            self._running.pop("slurmd").wait()

    def _of_node(self):
        """The daemon of this Slurm, and whatever has it among its ancestors or was started for its jobs."""
        own = []
        for place in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                environment = (place / "environ").read_bytes().split(b"\0")
                name = (place / "comm").read_text().strip()
                inside = f"SLURM_CONF={self.folder}/slurm.conf".encode() in environment
                if inside and (name in ("slurmd", "slurmstepd") or _has(environment, b"SLURM_JOB_ID=")):
                    own.append(int(place.name))
        return own

    def ask(self, *command):
        return subprocess.run(
            command, env=self.environment, capture_output=True, text=True, timeout=30
        ).stdout.strip()  # fmt: skip

    def jobs(self):
        """State of every job in the queue, by its number: {"2_0": "RUNNING"}."""
        lines = self.ask("squeue", "--noheader", "--array", "-o", "%i %T").splitlines()
        return dict(line.split() for line in lines)


def _has(environment, start):
    return any(entry.startswith(start) for entry in environment)


def _free_ports():
    with contextlib.ExitStack() as open_ones:
        sockets = [open_ones.enter_context(socket.socket()) for _ in range(2)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
