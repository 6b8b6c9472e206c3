"""The choice among couplings, made when a kernel is compiled: each name is one function, whatever holds the tool."""

from impact_gym.kernel import by_type
from impact_gym.physics.coupling import RigidLaw, SpringDamperLaw
from impact_gym.solver import rigid, spring_damper

width = by_type({RigidLaw: rigid.width, SpringDamperLaw: spring_damper.width})
reduced_mass = by_type({RigidLaw: rigid.reduced_mass, SpringDamperLaw: spring_damper.reduced_mass})
collision = by_type({RigidLaw: rigid.collision, SpringDamperLaw: spring_damper.collision})
load = by_type({RigidLaw: rigid.load, SpringDamperLaw: spring_damper.load})
rate = by_type({RigidLaw: rigid.rate, SpringDamperLaw: spring_damper.rate})
store = by_type({RigidLaw: rigid.store, SpringDamperLaw: spring_damper.store})
drift = by_type({RigidLaw: rigid.drift, SpringDamperLaw: spring_damper.drift})
touch_time = by_type({RigidLaw: rigid.touch_time, SpringDamperLaw: spring_damper.touch_time})
cannot_touch = by_type({RigidLaw: rigid.cannot_touch, SpringDamperLaw: spring_damper.cannot_touch})
coupling_impulse = by_type({RigidLaw: rigid.coupling_impulse, SpringDamperLaw: spring_damper.coupling_impulse})
coupling_force = by_type({RigidLaw: rigid.coupling_force, SpringDamperLaw: spring_damper.coupling_force})
