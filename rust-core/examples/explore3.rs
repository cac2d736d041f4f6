#![allow(missing_docs)]
use sgtd_core::albedo::*; use sgtd_core::albedo_table::*; use sgtd_core::ndf::*; use sgtd_core::shape::*; use sgtd_core::skewed_t::*; use glam::DVec3;
fn main(){
 let mut seed=12345u64; let mut rnd=move||{ seed=seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407); (seed>>11) as f64/(1u64<<53) as f64};
 for (g,p,l,m) in [(2.0,1.0,0.0,0.0),(40.0,1.0,0.0,0.0),(1.6,1.0,0.0,0.0),(f64::INFINITY,1.0,0.,0.),(2.,1.,0.,1.5),(1.9,1.3,0.4,0.6),(1.7,1.4,0.0,0.3),(f64::INFINITY,0.8,-0.5,1.0),(f64::INFINITY,2.5,0.,0.8),(f64::INFINITY,0.5,0.,0.),(1.52,1.0,0.,0.),(2.0,1.0,0.,5.),(2.0,50.0,0.,0.),(f64::INFINITY,50.0,0.,3.)] {
  let ndf=Ndf::new(Box::new(SkewedT::new(Shape::new(g,p,l,m).unwrap())),1e-5).unwrap();
  for sh in [Shadowing::Separable,Shadowing::HeightCorrelated] {
  let s=SingleScattering::new(&ndf,sh,Rule::REFERENCE);
  let mut out=String::new();
  for kind in 0..2 {
   let mut w_=0f64; let mut at=(0.,0.,0.,0.); let mut rms=0f64; let mut avg=0f64; let mut time=0.0; let mut reached=0f64; let mut cnt=0;
   for _ in 0..(if kind==0 {1} else {6}) {
    let fix=Roughness{u:0.05*40f64.powf(rnd()),v:0.05*40f64.powf(rnd())};
    let t0=std::time::Instant::now(); let t=if kind==0 {AlbedoTable::isotropic(&ndf,sh)} else {AlbedoTable::anisotropic(&ndf,sh,fix)}; time+=t0.elapsed().as_secs_f64()*1e3/(if kind==0 {1.} else {6.}); reached=reached.max(t.reached());
    for _ in 0..(if kind==0 {1500} else {300}) {
     let au=0.05*40f64.powf(rnd()); let al=if kind==0 {Roughness{u:au,v:au}} else {fix};
     let mu=if rnd()<0.3 {0.1*rnd()} else {rnd()}; let ph=6.2832*rnd(); let sn=(1.0-mu*mu).sqrt(); let w=DVec3::new(sn*ph.cos(),sn*ph.sin(),mu);
     let e=(t.loss(al,w)-s.loss(View::new(al,w))).abs(); rms+=e*e; cnt+=1; if !(e<=w_){w_=e;at=(al.u,al.v,mu,ph);} }
    for _ in 0..(if kind==0 {30} else {2}) { let au=(if rnd()<0.2 {0.001} else {0.05})*40f64.powf(rnd()); let al=if kind==0 {Roughness{u:au,v:au}} else {fix};
     let mut sum=0.0; let n=400; let nf=if kind==0 {1} else {60}; for i in 0..n { for j in 0..nf { let t_=(i as f64+0.5)/n as f64; let mu=t_*t_; let dmu=2.*t_/n as f64; let ph=(j as f64+0.5)/nf as f64*1.5707963; let sn=(1.-mu*mu).sqrt();
      sum+=t.loss(al,DVec3::new(sn*ph.cos(),sn*ph.sin(),mu))*2.*mu*dmu/nf as f64; } }
     let e=(sum/t.average_loss(al)-1.0).abs(); if !(e<=avg) {avg=e;} }
   }
   out+=&format!(" | {} {w_:.1e} rms {:.1e} at {at:.2?} reached {reached:.1e} avg {avg:.1e} {time:.0} ms",["iso","aniso"][kind],(rms/cnt as f64).sqrt());
  }
  println!("{g} {p} {l} {m} {sh:?}{out}");
 }}
}
