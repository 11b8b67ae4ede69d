"""TorchScript, ONNX and plain torch modules fly as the network they came from; anything else is named."""

import pickle
import warnings
import zipfile

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from stable_baselines3 import PPO

from agents import fly
from agents.policies import exported
from agents.policies.actions import PolicyFailed
from agents.policies.adapters import Adapted, load_policy
from agents.training.vec_env import make_vec_env

SEEN = np.random.default_rng(0).uniform(-1, 1, (4, 19)).astype(np.float32)


class Net(torch.nn.Module):
    """A linear policy."""

    def __init__(self, inputs: int = 19, outputs: int = 2) -> None:
        super().__init__()
        torch.manual_seed(inputs)
        self.layer = torch.nn.Linear(inputs, outputs)

    def forward(self, seen):
        return torch.tanh(self.layer(seen))


class WithValue(Net):
    """Returns actions, and the value of each state."""

    def forward(self, seen):
        acted = torch.tanh(self.layer(seen))
        return acted, acted.sum(dim=1)


class WithDeviation(Net):
    """Returns means and standard deviations."""

    def forward(self, seen):
        acted = torch.tanh(self.layer(seen))
        return acted, acted.exp()


class Writer(Net):
    """A network that writes a file."""

    def forward(self, seen):
        torch.save(seen, "sprung")
        return torch.tanh(self.layer(seen))


def script(module, path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.jit.save(torch.jit.script(module), str(path))
    return path


def write_onnx(module, path, batch="n", double=False, inputs=None):
    """Write a linear policy as ONNX, with batches of any size or of a fixed one."""
    weight, bias = (value.detach().numpy().astype(float if double else np.float32) for value in module.parameters())
    kind = TensorProto.DOUBLE if double else TensorProto.FLOAT
    graph = helper.make_graph(
        [
            helper.make_node("MatMul", ["seen", "weight"], ["product"]),
            helper.make_node("Add", ["product", "bias"], ["sum"]),
            helper.make_node("Tanh", ["sum"], ["actions"]),
        ],
        "policy",
        [helper.make_tensor_value_info("seen", kind, [batch, inputs or weight.shape[1]])],
        [helper.make_tensor_value_info("actions", kind, [batch, len(bias)])],
        [numpy_helper.from_array(weight.T.copy(), "weight"), numpy_helper.from_array(bias, "bias")],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10), path)
    return path


def expected(module, seen):
    with torch.no_grad():
        return module(torch.as_tensor(seen)).numpy()


@pytest.mark.parametrize("suffix", exported.TORCHSCRIPT)
def test_torchscript_acts_as_its_module_without_trust(tmp_path, suffix):
    policy = load_policy(str(script(Net(), tmp_path / f"policy{suffix}")))
    np.testing.assert_allclose(policy.predict(SEEN)[0], expected(Net(), SEEN), atol=1e-6)


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("batch", ["n", 1])
def test_onnx_acts_as_its_module_without_trust(tmp_path, batch, double):
    policy = load_policy(str(write_onnx(Net(), tmp_path / "policy.onnx", batch, double)))
    np.testing.assert_allclose(policy.predict(SEEN)[0], expected(Net(), SEEN), atol=1e-6)


def test_a_policy_of_stable_baselines3_is_exported_and_flies_alike(tmp_path):
    model = PPO("MlpPolicy", make_vec_env("hoop", 1), n_steps=8, batch_size=8, device="cpu", seed=0)

    class Actor(torch.nn.Module):
        def __init__(self, policy):
            super().__init__()
            self.body, self.head = policy.mlp_extractor.policy_net, policy.action_net

        def forward(self, seen):
            return self.head(self.body(seen))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        traced = torch.jit.trace(Actor(model.policy), torch.zeros(1, 19))
        torch.jit.save(traced, str(tmp_path / "ppo.pt"))
    one, other = fly(load_policy(str(tmp_path / "ppo.pt")), "hoop"), fly(model, "hoop")
    assert one.outcomes == other.outcomes
    np.testing.assert_allclose(one.actions[0], other.actions[0], atol=1e-5)


@pytest.mark.parametrize("write", [script, write_onnx])
def test_states_are_recognised_by_the_network(tmp_path, write):
    suffix = ".onnx" if write is write_onnx else ".pt"
    policy = load_policy(str(write(Net(5), tmp_path / f"policy{suffix}")))
    assert policy.observation_space.shape == (5,)
    assert fly(policy, "hoop").steps[0] > 0


def test_frames_are_recognised_by_the_shape_of_onnx(tmp_path):
    policy = load_policy(str(write_onnx(Net(38), tmp_path / "policy.onnx")))
    assert policy.observation_space.shape == (38,)
    assert fly(policy, "hoop").steps[0] > 0


@pytest.mark.parametrize("kind", [Net, lambda: Net(5), WithValue, lambda: Net().double()])
def test_plain_modules_are_flown(kind):
    policy = Adapted(kind(), "net")
    assert fly(policy, "hoop", 2).steps.tolist() == fly(policy, "hoop", 2).steps.tolist()


def test_dropout_is_off():
    module = torch.nn.Sequential(torch.nn.Dropout(0.5), Net())
    np.testing.assert_array_equal(Adapted(module, "net").predict(SEEN)[0], Adapted(module, "net").predict(SEEN)[0])


@pytest.mark.parametrize(
    ("module", "words"),
    [
        (Net(7), r"takes none of FlatQuad-v0's observations: 19 features: RuntimeError: .*; 5 state: RuntimeError"),
        (Net(19, 3), r"returned 1 values, of shapes \(2, 3\); wanted one of shape \(2, 2\)"),
        (WithDeviation(), r"returned 2 values, of shapes \(2, 2\), \(2, 2\); wanted one of shape \(2, 2\)"),
    ],
)
def test_modules_that_do_not_fit_are_named(module, words):
    with pytest.raises(PolicyFailed, match=words):
        Adapted(module, "net").predict(SEEN[:2])


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda path: torch.save(Net().state_dict(), path), "is no TorchScript: it holds weights"),
        (lambda path: torch.save(Net(), path), "is no TorchScript: it holds weights"),
        (lambda path: path.write_text("hello"), "is not a whole TorchScript archive"),
        (lambda path: path.touch(), "is not a whole TorchScript archive"),
        (lambda path: path.write_bytes(script(Net(), path).read_bytes()[:900]), "is not a whole TorchScript archive"),
        (lambda path: script(Net(7), path), "does not fit: the network takes none"),
    ],
)
def test_other_pt_files_are_named(tmp_path, write, words):
    write(tmp_path / "other.pt")
    with pytest.raises(ValueError, match=rf"other\.pt {words}"):
        load_policy(str(tmp_path / "other.pt"))


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda path: path.write_text("hello"), "is not an ONNX model that can be run"),
        (lambda path: path.write_bytes(write_onnx(Net(), path).read_bytes()[:80]), "is not an ONNX model"),
        (lambda path: write_onnx(Net(7), path), r"does not fit: the network takes observations of shape \(7,\)"),
    ],
)
def test_other_onnx_files_are_named(tmp_path, write, words):
    write(tmp_path / "other.onnx")
    with pytest.raises(ValueError, match=rf"other\.onnx {words}"):
        load_policy(str(tmp_path / "other.onnx"))


@pytest.mark.parametrize("name", ["nowhere.pt", "nowhere.onnx"])
def test_missing_files_are_named(name):
    with pytest.raises(FileNotFoundError, match=f"there is no file {name}"):
        load_policy(name)


def test_onnxruntime_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr("flatgym.extras.find_spec", lambda _: None)
    with pytest.raises(ImportError, match=r"onnxruntime not installed; run: pip install 'flatgym\[onnx\]'"):
        load_policy(str(write_onnx(Net(), tmp_path / "policy.onnx")))


class Trap:
    """An object that creates a file when unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_a_pickle_within_torchscript_is_not_run(tmp_path):
    path = script(Net(), tmp_path / "trap.pt")
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as file:
        for name, content in members.items():
            changed = pickle.dumps(Trap(tmp_path / "sprung"), 2) if name.endswith("data.pkl") else content
            file.writestr(name, changed)
    with pytest.raises(ValueError, match=r"trap\.pt is not TorchScript that this version of torch can load"):
        load_policy(str(path), trust=True)
    assert not (tmp_path / "sprung").exists()


def test_torchscript_that_writes_files_needs_trust(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = script(Writer(), tmp_path / "writer.pt")
    with pytest.raises(ValueError, match=r"writer\.pt may read or write files: its code calls save; .*--trust"):
        load_policy(str(path))
    assert not (tmp_path / "sprung").exists()
    assert load_policy(str(path), trust=True).predict(SEEN)[0].shape == (4, 2)


def test_every_operation_of_torch_on_files_is_known():
    """An operation that names a file has a name that FILE_OPERATIONS finds."""
    schemas = [schema for schema in torch._C._jit_get_all_schemas() if "str filename" in str(schema)]
    assert schemas
    for schema in schemas:
        assert exported.FILE_OPERATIONS.search(f"torch.{schema.name.split('::')[-1]}(")
