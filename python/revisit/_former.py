"""Former names of the public interface. They work for one release, with a DeprecationWarning.

dir() and the stubs have the current names only.
"""

import functools
import sys
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar('Function', bound=Callable[..., Any])

MAKES_STUBS = hasattr(sys.modules.get('__main__'), 'StubGen')
"""nanobind.stubgen imports this package."""

LISTED_PAIRS = {'right': 'correct', 'neither': 'ignored'}
REGISTRATION_OPTIONS = {
    'voxel': 'voxel_size', 'reach': 'search_radius', 'least_inliers': 'min_inlier_ratio', 'least_constraint': 'min_constraint'}
"""Keyword arguments that are attributes, too: former -> current."""

KEYWORDS = {
    'datasets.perturb': {'alteration': 'perturbation'},
    'engine.Net.plan': {'gray_offsets': 'channel_offsets'},
    'evaluation.ListedPairs.__init__': LISTED_PAIRS,
    'evaluation.bootstrap': {'verdicts': 'labels'},
    'evaluation.precision_recall': {'verdicts': 'labels'},
    'evaluation.summarize': {'verdicts': 'labels'},
    'maps.Detection.__init__': {'why_not': 'error'},
    'maps.LoopDetector.__init__': {'precision': 'target_precision'},
    'maps.MapStore.open': {'identity': 'fingerprint', 'numbers': 'dtype'},
    'maps.PlaceRecognizer.__init__': {'first_stretch': 'warmup', 'precision': 'target_precision'},
    'maps.PlaceRecognizer.query': {'without': 'exclude'},
    'maps.PlaceRecognizer.remove': {'positions': 'indices'},
    'recognition.choose_ring_model': {'made_by': 'feature_key'},
    'recognition.ring_recognizer': {
        'numbers': 'dim', 'regularisation': 'regularization', 'adapt': 'blend', 'key_candidates': 'candidates'},
    'registration.RegistrationOptions.__init__': REGISTRATION_OPTIONS,
    'registration.register_scans': {'turn': 'relative_yaw'},
}
"""Function of revisit._core -> former keyword argument -> current one."""

ATTRIBUTES = {
    'engine.LayerCost': {'why': 'selection_reason'},
    'engine.Net': {'takes_gray_input': 'takes_single_channel'},
    'evaluation.ListedPairs': LISTED_PAIRS,
    'evaluation.Task': {'stored': 'database'},
    'maps.Description': {'why_not': 'error'},
    'maps.Detection': {'position': 'index', 'why_not': 'error', 'refusal': 'rejection_reason'},
    'maps.Loop': {'position': 'index', 'runner_up': 'kth_similarity', 'turn': 'relative_yaw'},
    'maps.LoopSummary': {'left_out': 'skipped'},
    'maps.MapStore': {'identity': 'fingerprint', 'numbers': 'dtype'},
    'maps.PlaceRecognizer': {'refresh_on_news': 'refresh_if_updated'},
    'recognition.RingModel': {'learnt_from': 'trained_on'},
    'registration.Registration': {'fitness': 'mean_squared_distance', 'inliers': 'inlier_ratio'},
    'registration.RegistrationOptions': REGISTRATION_OPTIONS,
    'simulation.SimulationSummary': {'path_metres': 'path_meters'},
}
"""Class of revisit._core -> former attribute of its objects -> current one."""

OF_CLASSES = {
    'engine.Accuracy': {'USUAL': 'DEFAULT'},
    'maps.PlaceRecognizer': {'identity_of': 'fingerprint_of'},
}
"""Class of revisit._core -> former attribute of the class -> current one."""


def warn(former, name, level):
    warnings.warn(f'{former} is deprecated; use {name}', DeprecationWarning, stacklevel=level + 1)


def module_getattr(module: str, **names: str):
    """Makes the __getattr__ of a module. names: former -> current."""
    def getattribute(name):
        if name not in names:
            raise AttributeError(f'module {module!r} has no attribute {name!r}', name=name, obj=sys.modules[module])
        warn(f'{module}.{name}', names[name], 2)
        return getattr(sys.modules[module], names[name])
    return getattribute


def accept_attributes(kind: type, **names: str):
    """Gives objects of a class their former attributes. names: former -> current."""
    def getattribute(self, name, shown=kind.__name__):
        if name not in names:
            raise AttributeError(f'{type(self).__name__!r} object has no attribute {name!r}', name=name, obj=self)
        warn(f'{shown}.{name}', names[name], 2)
        return getattr(self, names[name])
    kind.__getattr__ = getattribute


def accept_keywords(**names: str) -> Callable[[Function], Function]:
    """Decorates a function of Python. names: former keyword argument -> current."""
    def decorated(function):
        @functools.wraps(function)
        def call(*args, **kwargs):
            for former, name in names.items():
                if former not in kwargs:
                    continue
                if name in kwargs:
                    raise TypeError(f'{function.__name__}() got multiple values for argument {name!r}')
                warn(f'{function.__name__}(): {former!r}', repr(name), 2)
                kwargs[name] = kwargs.pop(former)
            return function(*args, **kwargs)
        return call
    return decorated


class FormerAttribute:
    """Attribute of a class itself: a static method, or a member of an enumeration."""

    def __init__(self, former, name):
        self.former, self.name = former, name

    def __get__(self, instance, owner):
        warn(f'{owner.__name__}.{self.former}', self.name, 2)
        return getattr(owner, self.name)


def accept_in(core):
    """Must be called before other modules import from the extension."""
    if MAKES_STUBS:
        return

    def found(path):
        """Returns scope and name, or None in a build without the library."""
        library, *scopes, name = path.split('.')
        scope = getattr(core, library, None)
        if scope is None:
            return None
        for part in scopes:
            scope = getattr(scope, part)
        return scope, name

    for path, names in KEYWORDS.items():
        if at := found(path):
            core._accept_former_keywords(*at, names)
    for path, names in ATTRIBUTES.items():
        if at := found(path):
            accept_attributes(getattr(*at), **names)
    for path, names in OF_CLASSES.items():
        if at := found(path):
            for former, name in names.items():
                setattr(getattr(*at), former, FormerAttribute(former, name))
